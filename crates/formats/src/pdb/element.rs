//! Symbols of the elements.

/// All of them, and D for deuterium.
const SYMBOLS: &str = "H D He Li Be B C N O F Ne Na Mg Al Si P S Cl Ar K Ca Sc Ti V Cr Mn Fe Co Ni Cu Zn Ga Ge As Se Br Kr \
    Rb Sr Y Zr Nb Mo Tc Ru Rh Pd Ag Cd In Sn Sb Te I Xe Cs Ba La Ce Pr Nd Pm Sm Eu Gd Tb Dy Ho Er Tm Yb Lu Hf Ta W Re Os \
    Ir Pt Au Hg Tl Pb Bi Po At Rn Fr Ra Ac Th Pa U Np Pu Am Cm Bk Cf Es Fm Md No Lr Rf Db Sg Bh Hs Mt Ds Rg Cn Nh Fl Mc \
    Lv Ts Og";

/// The symbol that a text is, in any case.
pub(super) fn symbol(text: &str) -> Option<&'static str> {
    SYMBOLS.split_ascii_whitespace().find(|symbol| symbol.eq_ignore_ascii_case(text))
}

/// The atomic number of a symbol, in any case; `None` if it is none.
pub fn atomic_number(text: &str) -> Option<u8> {
    let position = SYMBOLS.split_ascii_whitespace().position(|symbol| symbol.eq_ignore_ascii_case(text))?;
    // Deuterium stands second and is hydrogen.
    u8::try_from(if position == 0 { 1 } else { position }).ok()
}

/// The symbol of an atomic number; `None` if there is none.
pub(crate) fn symbol_of_number(number: u8) -> Option<&'static str> {
    let place = if number == 1 { 0 } else { usize::from(number) };
    SYMBOLS.split_ascii_whitespace().nth(place).filter(|_| number > 0)
}
