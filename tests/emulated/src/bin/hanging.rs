//! Never ends: the time limit must cut the image.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

fn run() {
    kband_emulated::say!("this image never ends");
    loop {
        core::hint::spin_loop();
    }
}
