//! The command `phipsi`.

fn main() {}
