//! Fails: a failing check must make the run fail.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

fn run() {
    panic!("this image always fails");
}
