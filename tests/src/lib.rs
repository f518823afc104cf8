//! What the cross-crate tests share: where the emulator, the images and the reference data are.
