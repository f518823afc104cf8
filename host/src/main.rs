//! `kband` at the desk.

fn main() {}
