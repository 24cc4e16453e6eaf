//! DCD files byte by byte, against one that OpenMM wrote, and after a kill.

use phipsi_formats::dcd::{DcdTiming, DcdWriter};
use std::path::PathBuf;

/// Written by OpenMM 8.6.1 (`openmm.app.DCDFile`): three atoms, two frames, first step 10, interval 5, 2 fs.
const OPENMM: &[u8] = include_bytes!("dcd/openmm.dcd");
const TIMING: DcdTiming = DcdTiming { first_step: 10, interval: 5, dt_ps: 0.002 };
/// The titles differ: OpenMM's has the date.
const TITLES: std::ops::Range<usize> = 100..260;

/// The positions in it.
fn frame(k: i32) -> Vec<[f64; 3]> {
    let position = |i: i32| {
        let (i, k) = (f64::from(i), f64::from(k));
        [0.1 * i + k, -0.25 * i, 1e-4 * (i + 1.0) * (k + 1.0) / 3.0]
    };
    (0..3).map(position).collect()
}

/// A file that is removed again.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        Scratch(std::env::temp_dir().join(format!("phipsi-{}-{name}.dcd", std::process::id())))
    }
    fn bytes(&self) -> Vec<u8> {
        std::fs::read(&self.0).unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn equal_but_for_titles(a: &[u8], b: &[u8]) {
    assert_eq!(a.len(), b.len());
    let differing: Vec<usize> = (0..a.len()).filter(|i| a[*i] != b[*i] && !TITLES.contains(i)).collect();
    assert!(differing.is_empty(), "bytes {differing:?}");
}

#[test]
fn a_file_is_that_of_openmm() {
    let scratch = Scratch::new("same");
    let mut writer = DcdWriter::create(&scratch.0, 3, TIMING).unwrap();
    writer.write(&frame(0)).unwrap();
    writer.write(&frame(1)).unwrap();
    equal_but_for_titles(&scratch.bytes(), OPENMM);
    assert!(scratch.bytes()[TITLES].starts_with(b"Created by phipsi\0"));
}

#[test]
fn every_byte_is_what_the_format_says() {
    let scratch = Scratch::new("bytes");
    let mut writer =
        DcdWriter::create(&scratch.0, 2, DcdTiming { first_step: 0, interval: 100, dt_ps: 0.005 }).unwrap();
    let int = |bytes: &[u8], at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let float = |bytes: &[u8], at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    for k in 0..3 {
        let bytes = scratch.bytes();
        assert_eq!(bytes.len(), 276 + k * 48);
        assert_eq!((int(&bytes, 0), &bytes[4..8]), (84, &b"CORD"[..]));
        // The count is right after every frame.
        let last = 100 * (k as i32 - 1).max(0);
        assert_eq!([8, 12, 16, 20].map(|at| int(&bytes, at)), [k as i32, 0, 100, last]);
        assert_eq!(float(&bytes, 44), (0.005 / 0.04888821) as f32);
        let zero: Vec<usize> = (24..44).chain(48..84).collect();
        assert!(zero.into_iter().all(|at| bytes[at] == 0));
        assert_eq!(
            [84, 88, 92, 96, 260, 264, 268, 272].map(|at| int(&bytes, at)),
            [24, 84, 164, 2, 164, 4, 2, 4]
        );
        for frame in 0..k {
            for axis in 0..3 {
                let at = 276 + 48 * frame + 16 * axis;
                assert_eq!((int(&bytes, at), int(&bytes, at + 12)), (8, 8));
                for atom in 0..2 {
                    let expected = (10.0 * (0.25 * frame as f64 + axis as f64 - 0.125 * atom as f64)) as f32;
                    assert_eq!(float(&bytes, at + 4 + 4 * atom), expected);
                }
            }
        }
        let x = |axis: usize, atom: usize| 0.25 * k as f64 + axis as f64 - 0.125 * atom as f64;
        writer.write(&[0, 1].map(|atom| [0, 1, 2].map(|axis| x(axis, atom)))).unwrap();
    }
    assert_eq!(writer.frames(), 3);
}

#[test]
fn a_killed_run_goes_on_behind_its_last_whole_frame() {
    let scratch = Scratch::new("killed");
    let mut writer = DcdWriter::create(&scratch.0, 3, TIMING).unwrap();
    writer.write(&frame(0)).unwrap();
    drop(writer);
    // Killed in the middle of the second frame: it is in the file, but not counted.
    let mut bytes = scratch.bytes();
    bytes.extend([7; 25]);
    std::fs::write(&scratch.0, bytes).unwrap();
    let mut writer = DcdWriter::append(&scratch.0, 3).unwrap();
    assert_eq!(writer.frames(), 1);
    writer.write(&frame(1)).unwrap();
    equal_but_for_titles(&scratch.bytes(), OPENMM);
    // The same with the file of OpenMM.
    std::fs::write(&scratch.0, &OPENMM[..OPENMM.len() - 60]).unwrap();
    assert!(DcdWriter::append(&scratch.0, 3).unwrap_err().found.contains("2 frames, which need 396"));
    std::fs::write(&scratch.0, OPENMM).unwrap();
    assert_eq!(DcdWriter::append(&scratch.0, 3).unwrap().frames(), 2);
    assert_eq!(scratch.bytes(), OPENMM);
}

#[test]
fn what_cannot_be_written_is_an_error_and_changes_nothing() {
    let scratch = Scratch::new("refused");
    let mut writer = DcdWriter::create(&scratch.0, 3, TIMING).unwrap();
    writer.write(&frame(0)).unwrap();
    let before = scratch.bytes();
    assert_eq!(writer.write(&frame(0)[1..]).unwrap_err().found, "positions of 2 atoms");
    for bad in [f64::NAN, f64::INFINITY, 1e38] {
        let mut positions = frame(1);
        positions[2][1] = bad;
        assert!(writer.write(&positions).unwrap_err().found.ends_with("nm of atom 2"));
    }
    assert_eq!((scratch.bytes(), writer.frames()), (before.clone(), 1));
    writer.write(&frame(1)).unwrap();
    equal_but_for_titles(&scratch.bytes(), OPENMM);
    assert_eq!(DcdWriter::append(&scratch.0, 4).unwrap_err().found, "a trajectory of 3 atoms");
    for (at, value) in [(0, 83u8), (4, b'X'), (8, 0xff), (48, 1), (95, 0x80), (96, 3), (272, 5)] {
        let mut bytes = OPENMM.to_vec();
        bytes[at] = value;
        if at == 8 {
            bytes[8..12].fill(0xff);
        }
        std::fs::write(&scratch.0, &bytes).unwrap();
        let error = DcdWriter::append(&scratch.0, 3).unwrap_err();
        assert!(!error.to_string().is_empty());
        assert_eq!(scratch.bytes(), bytes, "byte {at}");
    }
    for length in [0, 8, 100, 275] {
        std::fs::write(&scratch.0, &OPENMM[..length]).unwrap();
        assert_eq!(DcdWriter::append(&scratch.0, 3).unwrap_err().found, "a file of less than 276 bytes");
    }
    for timing in [
        DcdTiming { first_step: -1, ..TIMING },
        DcdTiming { interval: 0, ..TIMING },
        DcdTiming { dt_ps: 0.0, ..TIMING },
        DcdTiming { dt_ps: f64::NAN, ..TIMING },
    ] {
        assert!(DcdWriter::create(&scratch.0, 3, timing).is_err());
    }
    assert!(DcdWriter::create(&scratch.0, 0, TIMING).is_err());
    assert!(DcdWriter::create(&scratch.0, usize::MAX, TIMING).is_err());
    assert!(DcdWriter::create("no such folder/run.dcd", 3, TIMING).is_err());
    assert!(DcdWriter::append("no such file.dcd", 3).is_err());
}
