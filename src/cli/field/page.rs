//! Report and renders of a field.

use super::scoring::Benchmark;
use crate::fit::field::Scores;
use crate::fit::field::benchmark::Relit;
use crate::io::image_file;
use crate::report::images::{data_uri, error_map};
use crate::report::run::{Run, decibel, iterations};
use crate::report::{Page, Section, Stat, table, text};
use crate::units::counted;
use crate::{Error, Result, console as cli};
use maud::html;
use serde_json::Value;
use std::path::Path;

/// Largest side of an image in the report, in pixels.
const SIDE: usize = 320;
/// Views that are shown.
const MOST: usize = 8;

/// What is shown.
pub(crate) struct Input<'a> {
    pub(crate) kind: &'static str,
    pub(crate) title: String,
    pub(crate) digest: Option<String>,
    /// See `fit::field::scores::means`.
    pub(crate) means: &'a Value,
    pub(crate) scored: &'a [Scores],
    /// Images that were read, by name, as data URIs; empty where they are those of a capture as they are.
    pub(crate) read: &'a [(String, String)],
    /// What a reader has to know beside the scores: facts of the run, by name.
    pub(crate) facts: Vec<(&'static str, String)>,
    /// Scores of Stanford-ORB, relit images, shape.
    pub(crate) benchmark: Option<&'a Benchmark>,
    pub(crate) run: Run<'a>,
}

/// The names of means, with their units and a factor.
const MEANS: [(&str, &str, &str); 11] = [
    ("psnr_db", "PSNR", "dB"),
    ("ssim", "SSIM", ""),
    ("mae", "MAE", ""),
    ("numerical_normals_deg", "numerical normals", "°"),
    ("normal_head_deg", "normal head", "°"),
    ("depth", "depth", "units"),
    ("albedo_db", "albedo PSNR", "dB"),
    ("albedo_aligned_db", "albedo, aligned", "dB"),
    ("albedo_orb_db", "albedo PSNR-A", "dB"),
    ("roughness", "roughness error", ""),
    ("metallic", "metallic error", ""),
];

/// The means as lines for a terminal.
pub(crate) fn summary(means: &Value) -> String {
    let lines: Vec<String> = MEANS
        .iter()
        .filter_map(|(key, name, unit)| {
            let line = format!("{name:18}  {:.4} {unit}", means[*key].as_f64()?);
            Some(line.trim_end().to_owned())
        })
        .collect();
    if lines.is_empty() { "no score: nothing is held out".to_owned() } else { lines.join("\n") }
}

/// Writes `heldout/NAME.png` and `normals/NAME.png`; gives the names.
pub(crate) fn write_renders(
    dir: &Path,
    scored: &[Scores],
    flat_name: &dyn Fn(&str) -> String,
) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for folder in ["heldout", "normals"] {
        let path = dir.join(folder);
        std::fs::create_dir_all(&path).map_err(|e| Error::os(&path, &e))?;
    }
    for s in scored {
        let score = &s.image.score;
        let normals: Vec<f32> = s.images.normals.iter().flat_map(|n| n.map(|x| 0.5 + 0.5 * x)).collect();
        for (folder, rgb) in [("heldout", &s.image.image), ("normals", &normals)] {
            let name = format!("{folder}/{}.png", flat_name(&score.name));
            let bytes = image_file::to_u8(rgb)?;
            image_file::write_png(&dir.join(&name), score.width, score.height, 3, &bytes)?;
            names.push(name);
        }
    }
    Ok(names)
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let mut facts = vec![("digest", x.digest.clone().unwrap_or_default())];
    facts.retain(|(_, value)| !value.is_empty());
    facts.extend(x.facts.iter().cloned());
    facts.extend(x.run.settings.get("seed").map(|seed| ("seed", seed.to_string())));
    let views = counted(x.scored.len(), "view");
    let stat = |label: &'static str, value: Option<String>| {
        value.map(|value| Stat { label, value, note: views.clone() })
    };
    let of = |key: &str| x.means[key].as_f64();
    let mut stats: Vec<Stat> = [
        stat("PSNR", of("psnr_db").map(decibel)),
        stat("SSIM", of("ssim").map(|s| format!("{s:.4}"))),
        stat("normals", of("numerical_normals_deg").map(|a| format!("{a:.1}°"))),
        stat("albedo PSNR", of("albedo_db").map(decibel)),
        stat("relit PSNR-mask", x.benchmark.and_then(Benchmark::relit_mask_db).map(decibel)),
    ]
    .into_iter()
    .flatten()
    .collect();
    stats.extend(x.run.history.map(|h| iterations(h, String::new())));
    stats.push(x.run.card());
    let mut sections = Vec::new();
    if !x.read.is_empty() {
        sections.push(read(x.read));
    }
    if !x.scored.is_empty() {
        sections.push(images(x)?);
        sections.push(scores(x));
    }
    if let Some(benchmark) = x.benchmark {
        sections.extend(relit(&benchmark.relit)?);
        sections.push(as_benchmark(benchmark));
    }
    sections.extend(x.run.course(
        "Loss",
        Some("samples"),
        " Samples are those that the rays of an iteration took.",
        &[],
    )?);
    sections.extend(x.run.tail());
    Ok(Page {
        kind: x.kind.into(),
        title: x.title.clone(),
        notice: "",
        command: cli::command_line(),
        facts,
        stats,
        sections,
    })
}

fn images(x: &Input<'_>) -> Result<Section> {
    let shown = x.scored.iter().take(MOST);
    let mut rows = Vec::new();
    for s in shown {
        let score = &s.image.score;
        let normals: Vec<f32> = s.images.normals.iter().flat_map(|n| n.map(|x| 0.5 + 0.5 * x)).collect();
        let uri = |rgb: &[f32]| data_uri(rgb, score.width, score.height, SIDE);
        let four =
            [uri(&s.image.photo)?, uri(&s.image.image)?, uri(&error_map(&s.image.error))?, uri(&normals)?];
        rows.push((format!("{}: {}", score.name, decibel(score.psnr_db)), four));
    }
    let heads = ["image", "render", "difference", "normals"];
    let more = match x.scored.len() {
        n if n > MOST => {
            format!(" The first {MOST} of {n} are shown; all renders are in heldout/ and normals/.")
        }
        _ => String::new(),
    };
    Ok(Section {
        id: "views",
        title: "Views beside their images",
        lead: format!(
            "Image over white, render of the field, absolute difference, and numerical normals at the surface (x, y, z \
             as red, green, blue). Pixels that are not scored are black: those that show the object in part, before a background that is not \
             white.{more}"
        ),
        body: html! {
            @for (name, four) in &rows {
                p { (name) }
                div style="display:grid;grid-template-columns:repeat(4,1fr);gap:4px" {
                    @for (head, uri) in heads.iter().zip(four) {
                        figure style="margin:0" { img src=(uri) alt=(format!("{head} of {name}")) style="width:100%"; figcaption { (head) } }
                    }
                }
            }
        },
    })
}

/// The images that were read.
fn read(all: &[(String, String)]) -> Section {
    Section {
        id: "read",
        title: "Images that were read",
        lead: "As the model read them: cut and shrunk, over white.".into(),
        body: html! {
            div style="display:grid;grid-template-columns:repeat(auto-fill,minmax(110px,1fr));gap:4px" {
                @for (name, uri) in all {
                    figure style="margin:0" { img src=(uri) alt=(name) style="width:100%"; figcaption { (name) } }
                }
            }
        },
    }
}

fn scores(x: &Input<'_>) -> Section {
    let number = |v: Option<f64>, digits: usize| text(v.map_or("–".to_owned(), |v| format!("{v:.digits$}")));
    let rows: Vec<Vec<_>> = x
        .scored
        .iter()
        .map(|s| {
            let score = &s.image.score;
            vec![
                text(&score.name),
                text(decibel(score.psnr_db)),
                number(Some(score.ssim), 4),
                number(s.numerical_deg, 2),
                number(s.head_deg, 2),
                number(s.depth, 5),
                number(s.materials.albedo_db, 2),
                number(s.materials.albedo_aligned_db, 2),
                number(s.materials.albedo_orb_db, 2),
                number(s.materials.roughness, 4),
                number(s.materials.metallic, 4),
            ]
        })
        .collect();
    let head = [
        "view",
        ">PSNR",
        ">SSIM",
        ">normals (°)",
        ">normal head (°)",
        ">depth",
        ">albedo (dB)",
        ">aligned (dB)",
        ">PSNR-A (dB)",
        ">roughness",
        ">metallic",
    ];
    let mean = |key: &str| !x.means[key].is_null();
    let keys = MEANS.iter().map(|(key, ..)| *key).filter(|key| *key != "mae");
    let is_there: Vec<bool> = std::iter::once(true).chain(keys.map(mean)).collect();
    let head: Vec<&str> = head.into_iter().zip(&is_there).filter(|(_, is)| **is).map(|(h, _)| h).collect();
    let rows: Vec<Vec<_>> = rows
        .into_iter()
        .map(|row| row.into_iter().zip(&is_there).filter(|(_, is)| **is).map(|(cell, _)| cell).collect())
        .collect();
    Section {
        id: "scores",
        title: "Scores per view",
        lead: "Normals and depth are compared where the surface is seen and a pass is there; depth is the mean absolute difference in units of \
               the world. Albedo is compared on covered pixels as it is, after the least-squares scale of each linear channel (aligned), and as \
               Stanford-ORB does (PSNR-A: linear, eroded mask, over the whole image). Roughness and metallic are mean absolute errors."
            .into(),
        body: table(&head, &rows),
    }
}

/// The relit images beside their truth.
fn relit(all: &[Relit]) -> Result<Option<Section>> {
    let mut rows = Vec::new();
    for r in all.iter().take(8) {
        let [w, h] = r.size;
        let off: Vec<f32> = (r.render.as_chunks::<3>().0.iter())
            .zip(r.truth.as_chunks::<3>().0)
            .map(|(a, b)| ((a[0] - b[0]).abs() + (a[1] - b[1]).abs() + (a[2] - b[2]).abs()) / 3.0)
            .collect();
        let uri = |rgb: &[f32]| data_uri(rgb, w, h, SIDE);
        let three = [uri(&r.truth)?, uri(&r.render)?, uri(&error_map(&off))?];
        let in_mask = r.scores.psnr_mask_db.map_or("–".to_owned(), decibel);
        let scales = r.scales.map(|s| format!("{s:.3}")).join(", ");
        rows.push((format!("{}: {in_mask} in the mask; scales {scales}", r.name), three));
    }
    if rows.is_empty() {
        return Ok(None);
    }
    let heads = ["truth", "relit", "difference"];
    Ok(Some(Section {
        id: "relit",
        title: "Relit images beside the truth",
        lead: "The object's mesh under the light of the image, path-traced, after the least-squares scale of each channel in the eroded mask.".into(),
        body: html! {
            @for (name, three) in &rows {
                p { (name) }
                div style="display:grid;grid-template-columns:repeat(3,1fr);gap:4px" {
                    @for (head, uri) in heads.iter().zip(three) { img src=(uri) alt=(format!("{head} of {name}")) style="width:100%"; }
                }
            }
        },
    }))
}

fn as_benchmark(x: &Benchmark) -> Section {
    let rows: Vec<Vec<_>> =
        x.rows().into_iter().map(|(what, name, value)| vec![text(what), text(name), text(value)]).collect();
    Section {
        id: "benchmark",
        title: "Scores as Stanford-ORB defines them",
        lead: "Means over the images. PSNR-H and PSNR-L are means over the whole image with its background, PSNR-mask and PSNR-eroded over the \
               pixels of the object; the first two are bounded from below by a constant foreground of 0.5. Depth has one scale per scene. The \
               shape is compared with the vertices of the true surface: as the published code returns it, and 2000 times that, as the \
               published table prints it; distances to triangles and between samples beside it."
            .into(),
        body: table(&["score", "definition", ">value"], &rows),
    }
}
