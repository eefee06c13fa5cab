//! The page about a mesh: facts as numbers, as lines, and as HTML.

use crate::geometry::facts::{Facts, Layout};
use crate::report::images::{Label, data_uri, strip};
use crate::report::run::Run;
use crate::report::{Page, Section, Stat, table, text, thousands};
use crate::scene::mesh::Object;
use crate::units::counted;
use crate::{Result, console as cli};
use maud::html;
use serde_json::{Value, json};

/// One side of the mesh.
pub(super) struct Turn {
    /// the azimuth, or `above`, `below`
    pub(super) name: String,
    /// width and height
    pub(super) size: [usize; 2],
    /// (H, W, 3), sRGB-encoded
    pub(super) image: Vec<f32>,
    /// (H, W, 3)
    pub(super) normals: Option<Vec<f32>>,
    /// (H, W, 3)
    pub(super) occlusion: Option<Vec<f32>>,
}

/// What is shown.
pub(super) struct Input<'a> {
    pub(super) title: String,
    pub(super) object: &'a Object,
    pub(super) facts: &'a Facts,
    pub(super) layout: Option<&'a Layout>,
    /// texels of the largest map
    pub(super) size: Option<[usize; 2]>,
    pub(super) turns: &'a [Turn],
    pub(super) sheets: &'a [(String, Label)],
    /// materials whose maps are not shown
    pub(super) left_out: usize,
    pub(super) run: Run<'a>,
}

/// The facts as JSON.
pub(super) fn record(object: &Object, f: &Facts, layout: Option<&Layout>) -> Value {
    let mesh = &object.mesh;
    let layout = layout.map(|l| {
        json!({
            "charts": l.charts, "texels_used": l.used, "texels_overlapping": l.overlapping,
            "density": { "p2.5": l.density[0], "p50": l.density[1], "p97.5": l.density[2] },
        })
    });
    json!({
        "vertices": mesh.positions.len(), "points": f.points, "triangles": mesh.triangles.len(),
        "degenerate_triangles": f.degenerate, "materials": object.materials.len(),
        "edges": { "regular": f.edges.regular, "open": f.edges.open, "irregular": f.edges.irregular },
        "closed": f.is_closed(), "parts": f.parts, "euler": f.euler(mesh.triangles.len()),
        "area": f.area, "volume": f.is_closed().then_some(f.volume), "turned_normals": f.turned,
        "box": mesh.bounds(), "texture": layout,
    })
}

/// Whether the surface is closed, in words.
fn closed(f: &Facts) -> String {
    if f.is_closed() {
        return "closed".to_owned();
    }
    let open = counted(f.edges.open, "open edge");
    match f.edges.irregular {
        0 => open,
        n => format!("{open}, {n} in more than two triangles or turned over"),
    }
}

/// Densities as texels per unit of length, and the factor between areas.
fn density(l: &Layout) -> (String, String) {
    let [low, middle, high] = l.density.map(f64::sqrt);
    (format!("{middle:.4} ({low:.4} to {high:.4})"), format!("{:.3}", l.density[2] / l.density[0]))
}

/// The facts, each with its value.
fn rows(object: &Object, f: &Facts, layout: Option<&Layout>) -> Vec<(&'static str, String)> {
    let mesh = &object.mesh;
    let [low, high] = mesh.bounds();
    let point = |p: [f32; 3]| format!("{:.4}, {:.4}, {:.4}", p[0], p[1], p[2]);
    let mut out = vec![
        ("vertices", format!("{} at {} points", thousands(mesh.positions.len()), thousands(f.points))),
        (
            "triangles",
            format!("{}, {} without area", thousands(mesh.triangles.len()), thousands(f.degenerate)),
        ),
        ("surface", closed(f)),
        ("parts", thousands(f.parts)),
        ("Euler characteristic", f.euler(mesh.triangles.len()).to_string()),
        ("box", format!("{} to {}", point(low), point(high))),
        ("area", format!("{:.6}", f.area)),
        ("volume", if f.is_closed() { format!("{:.6}", f.volume) } else { "none: not closed".into() }),
        (
            "normals",
            match mesh.normals.is_empty() {
                true => "none: faces are flat".into(),
                false => format!("{:.2} % of the area with normals to the back", 100.0 * f.turned),
            },
        ),
        ("materials", object.materials.len().to_string()),
    ];
    if let Some(l) = layout {
        let (length, factor) = density(l);
        out.extend([
            ("charts", thousands(l.charts)),
            ("texels used", format!("{:.1} %", 100.0 * l.used)),
            ("texels in two triangles", format!("{:.2} %", 100.0 * l.overlapping)),
            ("texels per unit of length", length),
            ("densities", format!("within a factor of {factor} for 95 % of the area")),
        ]);
    }
    out
}

/// The facts as lines for a terminal.
pub(super) fn lines(object: &Object, f: &Facts, layout: Option<&Layout>) -> Vec<String> {
    rows(object, f, layout).into_iter().map(|(name, value)| format!("{name:<26}  {value}")).collect()
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(super) fn page(x: &Input<'_>) -> Result<Page> {
    let mesh = &x.object.mesh;
    let mut stats = vec![
        Stat {
            label: "triangles",
            value: thousands(mesh.triangles.len()),
            note: counted(x.facts.parts, "part"),
        },
        Stat {
            label: "surface",
            value: if x.facts.is_closed() { "closed".into() } else { "open".into() },
            note: if x.facts.is_closed() { "every edge in two triangles".into() } else { closed(x.facts) },
        },
    ];
    stats.extend(x.layout.map(|l| Stat {
        label: "texels used",
        value: format!("{:.0} %", 100.0 * l.used),
        note: match x.size {
            Some([w, h]) => format!("of {w}×{h}, {}", counted(l.charts, "chart")),
            None => format!("no maps; {}", counted(l.charts, "chart")),
        },
    }));
    stats.push(x.run.card());
    let mut sections = vec![turntable(x.turns)?];
    sections.extend(maps(x.turns)?);
    if !x.sheets.is_empty() {
        let rest = match x.left_out {
            0 => String::new(),
            n => format!(" The maps of {} are not shown.", counted(n, "further material")),
        };
        sections.push(Section {
            id: "textures",
            title: "Texture sheets",
            lead: format!(
                "Every map, with the borders of charts in orange. Base colour and emission are sRGB-encoded; roughness and metallic are linear, \
                 white is 1.{rest}"
            ),
            body: html! { div.large { (strip(x.sheets)) } },
        });
    }
    let rows: Vec<Vec<_>> = rows(x.object, x.facts, x.layout)
        .into_iter()
        .map(|(name, value)| vec![text(name), text(value)])
        .collect();
    sections.push(Section {
        id: "facts",
        title: "Facts",
        lead: "Vertices with equal positions count as one point. Lengths are in units of the file. Densities lie between the values below which \
               2.5 % and 97.5 % of the area lie."
            .into(),
        body: table(&["fact", "value"], &rows),
    });
    sections.extend(x.run.tail());
    Ok(Page {
        kind: "mesh view".into(),
        title: x.title.clone(),
        notice: "",
        command: cli::command_line(),
        facts: Vec::new(),
        stats,
        sections,
    })
}

fn figure(turn: &Turn, rgb: &[f32], what: &str) -> Result<(String, Label)> {
    let uri = data_uri(rgb, turn.size[0], turn.size[1], 400)?;
    Ok((uri, Label { alt: format!("{what} from {}", turn.name), caption: turn.name.clone() }))
}

fn turntable(turns: &[Turn]) -> Result<Section> {
    let figures = turns.iter().map(|t| figure(t, &t.image, "the mesh")).collect::<Result<Vec<_>>>()?;
    Ok(Section {
        id: "turntable",
        title: "Turntable",
        lead: "In a built-in studio, from azimuths in steps of 45° at 15° above the horizon, from above and from below, with one exposure.".into(),
        body: strip(&figures),
    })
}

fn maps(turns: &[Turn]) -> Result<Option<Section>> {
    let of = |what: &str, get: &dyn Fn(&Turn) -> Option<&Vec<f32>>| {
        let shown = turns.iter().filter_map(|t| get(t).map(|rgb| figure(t, rgb, what)));
        shown.collect::<Result<Vec<_>>>()
    };
    let normals = of("shading normals", &|t| t.normals.as_ref())?;
    let occlusion = of("ambient occlusion", &|t| t.occlusion.as_ref())?;
    Ok((!normals.is_empty()).then(|| Section {
        id: "maps",
        title: "Normals and occlusion",
        lead: "Shading normals in world space (x, y, z as red, green, blue; 0.5 is zero). Below, the radiance of white plaster under uniform light \
               without bounces: the part of the sky that a point sees, weighted by the cosine (over grey)."
            .into(),
        body: html! { (strip(&normals)) (strip(&occlusion)) },
    }))
}
