//! `kband` at the desk: the thin binary over the verbs.

use std::process::ExitCode;

fn main() -> ExitCode {
    kband_host::verbs::main()
}
