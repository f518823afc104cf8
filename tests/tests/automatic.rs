//! The automatic check ends and reports, for any behaviour of its steps and its caller.

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kband_tests::root;

/// Runs a copy of `.ci/run` over test steps; returns exit status and output. Its standard input
/// never ends, and its output is read only after it has ended.
fn automatic_check(steps: &str, limit: &str) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in [".ci", "tests"] {
        fs::create_dir(folder.path().join(name)).expect("a folder");
    }
    fs::copy(root().join(".ci/run"), folder.path().join(".ci/run")).expect(".ci/run is copied");
    fs::write(folder.path().join("tests/run.sh"), steps).expect("the steps are written");
    let mut child = Command::new("bash")
        .arg(".ci/run")
        .current_dir(&folder)
        .env("KBAND_CI_LIMIT", limit)
        .env("CI", "true")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("bash starts");
    let input = child.stdin.take();
    let last = Instant::now() + Duration::from_secs(100);
    while child.try_wait().expect("it can be waited for").is_none() {
        if Instant::now() > last {
            let _ = child.kill();
            panic!(".ci/run did not end");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(input);
    // This returns only after every process has closed the pipe.
    let output = child.wait_with_output().expect("the output is read");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    (output.status.code(), text)
}

#[test]
fn processes_left_over_do_not_hold_the_caller() {
    let steps = "sleep 300 & setsid sleep 300 & (setsid nohup sleep 300 &) ; read -r line; echo done; exit 3";
    let (status, output) = automatic_check(steps, "90");
    assert_eq!(status, Some(3), "{output}");
    assert!(output.contains("done\n"), "{output}");
    assert!(output.contains("exit status 3"), "{output}");
}

#[test]
fn a_hanging_step_is_cut() {
    let (status, output) = automatic_check("sleep 300 & echo begun; sleep 300", "2");
    assert_eq!(status, Some(124), "{output}");
    assert!(output.contains("begun\n"), "{output}");
    assert!(output.contains("cut by the overall limit"), "{output}");
}
