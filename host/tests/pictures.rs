//! The pictures of the manual match the output of their commands.

use std::path::PathBuf;
use std::process::{Command, Stdio};

#[test]
fn every_picture_is_what_its_command_draws() {
    let root: PathBuf = [env!("CARGO_MANIFEST_DIR"), ".."].iter().collect();
    let output = Command::new("bash")
        .arg(root.join("docs/pictures/draw.sh"))
        .arg("--check")
        .env("KBAND", env!("CARGO_BIN_EXE_kband"))
        .stdin(Stdio::null())
        .output()
        .expect("bash is on the path");
    let printed = String::from_utf8_lossy(&output.stdout);
    let stderr = String::from_utf8_lossy(&output.stderr);
    let same = output.status.success();
    assert!(same, "docs/pictures/draw.sh draws anew:\n{printed}{stderr}");
}
