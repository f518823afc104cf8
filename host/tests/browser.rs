//! Pictures in a real browser.

mod came;

use came::kband;
use kband_machines::browser::Browser;

/// For each figure of a page, how many dots and middles of lines' first segments lie within its own
/// clip, and at how many of them the browser finds the mark.
const MARKS: &str = "
    return [...document.querySelectorAll('svg')].map((svg) => {
        svg.scrollIntoView();
        let [due, seen] = [0, 0];
        for (const path of svg.querySelectorAll('path[clip-path]:not([stroke-dasharray])')) {
            const own = svg.querySelector(path.getAttribute('clip-path').slice(4, -1) + ' rect');
            const box = own.getBBox();
            const starts = /M([0-9.-]+) ([0-9.-]+)(?:L([0-9.-]+) ([0-9.-]+))?/g;
            for (const [, ...ends] of path.getAttribute('d').matchAll(starts)) {
                const [u, v, s = u, t = v] = ends.map((end) => end && Number(end));
                const [x, y] = [(u + s) / 2, (v + t) / 2];
                const [right, below] = [x - box.x, y - box.y];
                if (right < 1 || right > box.width - 1 || below < 1 || below > box.height - 1) continue;
                due += 1;
                const at = new DOMPoint(x, y).matrixTransform(path.getScreenCTM());
                seen += document.elementsFromPoint(at.x, at.y).includes(path);
            }
        }
        return [due, seen];
    })";

#[test]
fn browser_shows_every_mark_of_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let browser = Browser::start();
    // Higher than the picture: only what is in the window can be found there.
    browser.resize(1000, 1500);
    for (words, least) in [
        (
            "transport --restitution 0.2 --impacts 400 --settle 200",
            300,
        ),
        ("exponent --k 0.32..0.48:40 --impacts 320 --settle 100", 40),
        ("margins", 4),
    ] {
        kband(&folder, &format!("{words} --out a.svg")).ended(0);
        browser.open(&folder.path().join("a.svg"));
        let figures = browser.script(MARKS);
        let [due, seen] = [0, 1].map(|which| figures[0][which].as_u64().unwrap());
        assert_eq!(seen, due, "{words}");
        assert!(due >= least, "{words}: {due}");
    }
}
