//! Binary `kband`; the verbs are in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    kband_host::verbs::main()
}
