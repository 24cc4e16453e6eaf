//! The instruction level that a run's last bits depend on.

/// Architecture, the SIMD level that kernels use ([`phipsi_spatial::lanes::Level`], forced by `PHIPSI_SIMD`), and whether the
/// processor has the fused multiply-add that the system's sine and cosine use if they can.
///
/// Two runs of the same inputs agree to the last bit where this text, the version of phipsi and the system's mathematical
/// library agree.
pub fn instruction_level() -> String {
    let arch = std::env::consts::ARCH;
    let os = std::env::consts::OS;
    let level = phipsi_spatial::lanes::Level::best().name();
    format!("{arch} {os} {level}, system functions {}", if has_fused() { "with fma" } else { "without fma" })
}

#[cfg(target_arch = "x86_64")]
fn has_fused() -> bool {
    std::arch::is_x86_feature_detected!("fma")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_fused() -> bool {
    true
}
