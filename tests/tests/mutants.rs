//! The list of mutants matches the sources: each place occurs in its file exactly once.

#[test]
fn each_mutant_is_at_its_place() {
    let checked = std::process::Command::new("python3")
        .arg(kband_tests::root().join("tests/mutants/run.py"))
        .arg("--check")
        .output()
        .expect("python3 is on the path");
    let printed = String::from_utf8_lossy(&checked.stdout);
    let wrong = String::from_utf8_lossy(&checked.stderr);
    assert!(checked.status.success(), "{printed}{wrong}");
    println!("{printed}");
}
