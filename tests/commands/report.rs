//! Reports as HTML text: what a reader without eyes, without a network or with a telephone gets.

use crate::program::{json, lastlight};
use lastlight::io::npz;
use std::path::Path;

/// The value of an attribute of a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let start = tag.find(&format!(" {name}=\""))? + name.len() + 3;
    tag[start..].split('"').next()
}

/// The opening tags with that name, without their ends.
fn tags<'a>(html: &'a str, name: &str) -> Vec<&'a str> {
    let open = format!("<{name} ");
    html.match_indices(&open).map(|(at, _)| html[at..].split('>').next().expect("a tag ends")).collect()
}

/// Checks what holds for every report; gives the page.
pub(crate) fn checked(path: &Path) -> String {
    let html = std::fs::read_to_string(path).expect("a report");
    for word in [
        "http://", "https://", "<script", "<link", "<iframe", "<object", "@import", "url(", "srcset",
        " onclick",
    ] {
        assert!(!html.contains(word), "{}: '{word}' would load or run something", path.display());
    }
    assert!(html.contains("Content-Security-Policy"), "the page has a policy");
    for img in tags(&html, "img") {
        assert!(
            attribute(img, "src").is_some_and(|s| s.starts_with("data:image/png;base64,")),
            "inside the page"
        );
    }
    // What may be wider than a telephone scrolls in a box of its own.
    for (at, _) in html.match_indices("<table") {
        assert!(
            html[..at].ends_with("<div class=\"scroll\">"),
            "{}: a table that does not scroll",
            path.display()
        );
    }
    assert!(html.contains("name=\"viewport\" content=\"width=device-width"), "the width of the screen");
    let mut names: Vec<&str> = Vec::new();
    for (tag, name) in [("img", "alt"), ("svg", "aria-label")] {
        names.extend(tags(&html, tag).iter().map(|t| attribute(t, name).unwrap_or_default()));
    }
    assert!(!names.is_empty() && names.iter().all(|n| n.len() > 8), "{}: {names:?}", path.display());
    names.sort_unstable();
    let twice: Vec<_> = names.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    assert!(twice.is_empty(), "{}: alternative texts that are there twice: {twice:?}", path.display());
    let mut ids: Vec<&str> = html.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    ids.sort_unstable();
    let twice: Vec<_> = ids.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    assert!(twice.is_empty(), "{}: ids that are there twice: {twice:?}", path.display());
    html
}

/// The text between the first two marks.
fn between<'a>(html: &'a str, start: &str, end: &str) -> &'a str {
    let at = html.find(start).unwrap_or_else(|| panic!("'{start}' in the page")) + start.len();
    html[at..].split(end).next().expect("something")
}

#[test]
fn the_report_of_the_demo_says_what_it_shows() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let record = json(&["demo", "--iterations", "24", "--json", "--quiet"], dir.path());
    // Each part has its own time (the scene had that of the whole demo).
    let seconds = |v: &serde_json::Value| v["seconds"].as_f64().expect("seconds");
    let parts = ["person", "object", "scene"].map(|part| seconds(&record[part]));
    assert!(parts.iter().all(|s| *s > 0.0), "{parts:?}");
    assert!(parts[0] + parts[1] + parts[2] <= seconds(&record), "{parts:?}");
    for part in ["person", "scene"] {
        assert_eq!(record[part]["iterations"], 24, "{part}: as requested");
    }
    let psnr = |round: usize| record["object"]["rounds"][round]["psnr_db"].as_f64().expect("a score");
    assert!(psnr(1) > psnr(0) && psnr(0) > 15.0, "the included model: {} and {} dB", psnr(0), psnr(1));
    for file in [
        "person/avatar.safetensors",
        "tuned.safetensors",
        "turntable.png",
        "interventions/grid.png",
        "object/second/field.safetensors",
        "object/mesh.glb",
        "object/relit.png",
    ] {
        assert!(dir.path().join("demo").join(file).is_file(), "{file} is there");
    }

    let html = checked(&dir.path().join("demo/report/index.html"));
    let title = "<h1>A person from a video, an object from a few images, a scene from images</h1>";
    assert!(html.contains(title), "a title");
    let person = ["subject", "structure", "views", "turntable", "grid", "moved"];
    for id in [&person[..], &["object", "rounds", "relit", "scene", "time", "settings"]].concat() {
        assert_eq!(html.matches(&format!("<section id=\"{id}\">")).count(), 1, "section '{id}', once");
    }
    for fact in ["date", "commit", "rustc", "processor", "threads", "digest of the person"] {
        assert!(html.contains(&format!("<dt>{fact}</dt>")), "{fact}");
    }
    // The worst view first, named with its score.
    let renders: Vec<&str> = tags(&html, "img")
        .iter()
        .filter_map(|t| attribute(t, "alt"))
        .filter(|a| a.starts_with("render of scored view"))
        .collect();
    let level = |alt: &&str| -> f64 {
        let text = alt.split("PSNR ").nth(1).expect("a score").trim_end_matches(" dB");
        text.parse().unwrap_or_else(|_| panic!("a number in '{alt}'"))
    };
    let levels: Vec<f64> = renders.iter().map(level).collect();
    assert!(levels.len() > 1 && levels.is_sorted(), "{renders:?}");
    // Two graphs, one line for each edge that is in the graph, true or probable.
    let structure = &record["person"]["structure"];
    let graphs: Vec<&str> = html.split("<svg ").filter(|s| s.contains("aria-label=\"causal graph")).collect();
    assert_eq!(graphs.len(), 2, "before and after");
    for (svg, which) in graphs.iter().zip(["before", "after"]) {
        let drawn = (0..16).filter(|at| {
            let (i, j) = (at / 4, at % 4);
            let pair = serde_json::json!([i, j]);
            let kept = structure[format!("edges_{which}")].as_array().expect("edges").contains(&pair);
            i != j
                && (kept
                    || structure["truth"][i][j] == true
                    || structure[which][at].as_f64().expect("p") >= 0.05)
        });
        let svg = svg.split("</svg>").next().expect("closed");
        assert_eq!(svg.matches("class=\"edge\"").count(), drawn.count(), "{which}: one line per edge");
        assert_eq!(svg.matches("class=\"truth\"").count(), 2, "{which}: the true edges");
    }
    // The grid: a row per factor, a column per value, the middle one marked.
    let grid = between(&html, "<table class=\"grid-table\">", "</table>");
    for name in ["posture", "self-occlusion", "wrinkles", "light"] {
        assert!(grid.contains(&format!("<th scope=\"row\">{name}</th>")), "{name}: {}", &grid[..400]);
    }
    assert_eq!(grid.matches("<img ").count(), 36, "nine values of four factors");
    assert_eq!(grid.matches("class=\"mid\"").count(), 5, "the middle column: its head and four cells");
    assert_eq!(grid.matches("<small>0 σ</small>").count(), 4, "values are distances from the middle");
    assert!(html.contains("decoder's person") || html.contains("decoder&#39;s person"), "whose person it is");
    // Settings as typed, what was changed first.
    let settings = between(&html, "<section id=\"settings\">", "</section>");
    assert!(settings.contains("<code>0.6</code>") && !settings.contains("0.60000002"), "as typed");
    let changed = between(settings, "Different from the defaults", "</table>");
    assert!(changed.contains("<code>24</code>") && changed.contains("<code>400</code>"), "{changed}");
    assert!(html.contains("<dt>PSNR-box</dt>") && html.contains("<abbr title="), "metrics are explained");
    assert_eq!(html.matches("iteration 0 · ").count(), 1, "the first picture of the training strip");

    let again = json(&["demo", "--only", "splat", "--iterations", "24", "--json", "--quiet"], dir.path());
    assert_eq!(
        again["scene"]["digest"], record["scene"]["digest"],
        "again, into the same folder: the same scene"
    );
    assert!(again["person"].is_null() && again["object"].is_null(), "one part alone");
    let digest = &record["person"]["digest"];
    let again = json(&["demo", "--iterations", "24", "--json", "-q", "--only", "last"], dir.path());
    assert_eq!(&again["person"]["digest"], digest, "again, the same person");

    fits(dir.path());
    interventions(dir.path());
}

/// The report of a fit of the demo's person: a title that says what it is, a strip that a resumed fit has too.
fn fits(dir: &Path) {
    let fit =
        ["last", "fit", "demo/subject/video", "--out", "fit", "--iterations", "60", "--json", "--quiet"];
    let digest = json(&fit, dir)["digest"].clone();
    let html = checked(&dir.join("fit/report/index.html"));
    assert!(html.contains("<h1>Person from the video subject/video</h1>"), "the folder above says more");
    let strip = |html: &str| -> Vec<String> {
        let all = tags(html, "img").into_iter().filter_map(|t| attribute(t, "alt"));
        all.filter(|a| a.starts_with("render of view ")).map(str::to_owned).collect()
    };
    let shown = strip(&html);
    assert_eq!(shown.len(), 3, "after 0, 50 and all 60 iterations: {shown:?}");
    for (alt, iteration) in shown.iter().zip([0, 50, 60]) {
        assert!(alt.contains(&format!("after {iteration} iterations, PSNR-box ")), "{alt}");
    }
    assert!(html.contains("aria-label=\"PSNR-box of view "), "and its score as a curve");
    let again: Vec<&str> = fit.iter().copied().chain(["--resume"]).collect();
    assert_eq!(json(&again, dir)["digest"], digest, "the finished fit");
    assert_eq!(
        strip(&checked(&dir.join("fit/report/index.html"))),
        shown,
        "what was recorded before is there"
    );
}

/// Two runs of an operator, one of them with a wrong gradient.
#[test]
fn the_page_of_a_comparison_shows_the_first_difference() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| dir.path().join(name);
    let run = |args: &[&str]| lastlight(args, dir.path()).status.code();
    assert_eq!(run(&["oracle", "mint", "splat.render", "--out", "g"]), Some(0), "mint");
    let file =
        ["oracle", "run", "splat.render", "--in", "g/splat.render_0.npz", "--out", "ours.npz", "--dump"];
    assert_eq!(run(&file), Some(0), "run");
    let mut theirs = npz::read(&at("ours.npz")).expect("written");
    let (shape, values) = {
        let quats = theirs.need("quats_bar").expect("a gradient");
        (quats.shape().to_vec(), quats.to_f32().iter().map(|x| x * 1.01).collect::<Vec<f32>>())
    };
    theirs.put("quats_bar", &shape, values);
    npz::write(&at("mine.npz"), &theirs).expect("written");
    assert_eq!(
        run(&["oracle", "compare", "mine.npz", "ours.npz", "--html", "c.html"]),
        Some(1),
        "they differ"
    );
    let html = checked(&at("c.html"));
    assert!(html.contains("<h1>splat.render: first difference in "), "a title");
    assert_eq!(html.matches("class=\"first\"").count(), 1, "one stage is the first");
    assert!(html.matches("class=\"ok\"").count() >= 3, "stages before it match");
    assert!(html.contains("alt=\"errors of quats_bar by row"), "a heat map over Gaussians");
    assert!(html.contains("log₁₀ of the relative error of quats_bar"), "a histogram");
    assert_eq!(
        run(&["oracle", "compare", "ours.npz", "ours.npz", "--html", "d.html"]),
        Some(0),
        "they agree"
    );
    let html = std::fs::read_to_string(at("d.html")).expect("written");
    assert!(
        html.contains("<h1>splat.render: all arrays match</h1>") && !html.contains("class=\"first\""),
        "all is well"
    );
}

/// The report of interventions on the demo's person.
fn interventions(dir: &Path) {
    let set = [
        "last",
        "intervene",
        "demo/tuned.safetensors",
        "demo/subject/video",
        "--out",
        "do",
        "--factor",
        "0",
        "--json",
        "--quiet",
    ];
    json(&set, dir);
    let html = checked(&dir.join("do/report/index.html"));
    assert!(html.contains("<h1>Interventions on subject/video by demo/tuned.safetensors</h1>"), "a title");
    let grid = between(&html, "<table class=\"grid-table\">", "</table>");
    assert_eq!(grid.matches("<img ").count(), 9, "one factor");
}
