//! What to try next: rules on the scores and the course of a fit, each with the observation that led to it.

use super::Section;
use super::run::Run;
use crate::num::order;
use crate::units::counted;
use maud::html;

/// Decibels below the mean from which on a view is mentioned.
const FAR_BELOW_DB: f64 = 2.5;
/// Distance to the nearest fitted camera, in units of the usual one, from which on a view counts as badly covered.
const FAR: f64 = 1.6;
/// Relative difference of brightness that is mentioned.
const BRIGHTNESS: f64 = 0.07;
/// Relative decrease of the loss from the last but one tenth of the iterations to the last one that is mentioned.
const FALLING: f64 = 0.02;
/// Number of training photos below which more photos are the first advice.
const FEW_PHOTOS: usize = 20;
/// Decrease in dB of the held-out score from its best snapshot to the last one that is mentioned.
const OVERFIT_DB: f64 = 0.5;
/// What to do about it.
const TAKE_MORE: &str = "Take 60 to 200 sharp photos of a full orbit, from two heights and with much overlap (`lastlight help captures`).";
/// Most views that are named in a hint.
const NAMED: usize = 3;

/// A scored view.
pub(super) struct View<'a> {
    pub(super) name: &'a str,
    pub(super) psnr_db: f64,
    /// (H, W, 3), 0 where it does not count
    pub(super) photo: &'a [f32],
    /// (H, W, 3)
    pub(super) image: &'a [f32],
    /// to the nearest fitted camera, in units of the usual distance between fitted cameras, where it is known
    pub(super) distance: Option<f64>,
}

/// The factor of the render that fits the photo best, over pixels that count.
fn gain(v: &View<'_>) -> f64 {
    let (mut both, mut own) = (0.0, 0.0);
    for (p, r) in v.photo.chunks_exact(3).zip(v.image.chunks_exact(3)) {
        if p.iter().any(|&x| x > 0.0) {
            for c in 0..3 {
                both += f64::from(p[c]) * f64::from(r[c]);
                own += f64::from(r[c]) * f64::from(r[c]);
            }
        }
    }
    if own > 0.0 { both / own } else { 1.0 }
}

/// Some names, and how many more there are.
fn named(names: &[&str]) -> String {
    let some = names[..Ord::min(NAMED, names.len())].join(", ");
    if names.len() > NAMED { format!("{some} and {} more", names.len() - NAMED) } else { some }
}

fn median(values: &[f32]) -> f64 {
    let mut sorted: Vec<f32> = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get(sorted.len() / 2).map_or(f64::NAN, |&x| f64::from(x))
}

/// Number of iterations of a fit and that of the command without options, if the fit had less than half of them.
fn short(run: &Run<'_>) -> Option<[usize; 2]> {
    let usual = run.defaults.as_ref()?.get("iterations")?.as_u64()? as usize;
    let done = run.history?.len();
    (2 * done < usual).then_some([done, usual])
}

/// Hints on single views; after a short fit, none on brightness, which it has not reached yet.
fn on_views(views: &[View<'_>], is_short: bool) -> Vec<String> {
    let finite: Vec<&View<'_>> = views.iter().filter(|v| v.psnr_db.is_finite()).collect();
    let mean = finite.iter().fold(0.0, |s, v| s + v.psnr_db) / finite.len() as f64;
    let low: Vec<&&View<'_>> = finite.iter().filter(|v| v.psnr_db < mean - FAR_BELOW_DB).collect();
    let is_far = |v: &View<'_>| v.distance.is_some_and(|d| d >= FAR);
    let mut hints = Vec::new();
    let uncovered: Vec<&str> = low.iter().filter(|v| is_far(v)).map(|v| v.name).collect();
    if !uncovered.is_empty() {
        hints.push(format!(
            "Badly covered: {} – more than {FAR_BELOW_DB} dB below the mean, and the nearest fitted camera is at least {FAR} times as far away as \
             usual. Add images from there.",
            named(&uncovered)
        ));
    }
    let other: Vec<&str> = low.iter().filter(|v| !is_far(v)).map(|v| v.name).collect();
    if !other.is_empty() {
        hints.push(format!(
            "Low scores: {} – more than {FAR_BELOW_DB} dB below the mean. Errors along all edges point to camera poses or lens distortion, errors in \
             one place to something that moved or that few images show.",
            named(&other)
        ));
    }
    let different: Vec<&str> =
        finite.iter().filter(|v| (gain(v) - 1.0).abs() > BRIGHTNESS).map(|v| v.name).collect();
    if !different.is_empty() && !is_short {
        hints.push(format!(
            "Brightness: in {} the image and its render differ by more than {:.0} % overall. Take the images with fixed exposure and white \
             balance.",
            named(&different),
            100.0 * BRIGHTNESS
        ));
    }
    hints
}

/// The best score of held-out views during a fit and its iteration, and the last score, if the score decreased while the training loss did.
fn overfit(run: &Run<'_>) -> Option<(f64, usize, f64)> {
    let (film, loss) = (run.film?, &run.history?.loss);
    let last = film.all.last()?;
    let best = film.all.iter().max_by(|a, b| a.psnr_db.total_cmp(&b.psnr_db))?;
    // Medians of the two halves of the iterations since then.
    let window = loss.len().saturating_sub(best.iteration) / 2;
    let falls = window > 0
        && median(&loss[loss.len() - window..]) < median(&loss[loss.len() - 2 * window..loss.len() - window]);
    (falls && last.psnr_db < best.psnr_db - OVERFIT_DB).then_some((
        best.psnr_db,
        best.iteration,
        last.psnr_db,
    ))
}

/// The hint on the number of photos; `photos` is the number of those that were fitted, where it is known.
fn on_photos(run: &Run<'_>, photos: Option<usize>, has_scores: bool) -> Option<String> {
    run.history?;
    let few = photos.filter(|&n| n < FEW_PHOTOS).map(|n| {
        let trained = counted(n, "training photo");
        format!("this fit had {trained}, and neither iterations nor Gaussians replace views that are missing")
    });
    let falling = || {
        let (best, at, last) = overfit(run).filter(|_| photos.is_some() && has_scores)?;
        Some(format!(
            "the held-out PSNR fell from {best:.1} dB (iteration {at}) to {last:.1} dB while the training loss fell: the scene fits \
             the training photos better and other views worse"
        ))
    };
    few.or_else(falling).map(|why| format!("More photos: {why}. {TAKE_MORE}"))
}

/// Hints on the course of the fit; `size` is the number of Gaussians, `is_first` whether no hint precedes them.
fn on_course(run: &Run<'_>, size: usize, is_first: bool) -> Vec<String> {
    let mut hints = Vec::new();
    let Some(history) = run.history else { return hints };
    let tenth = history.len() / 10;
    if let Some([done, usual]) = short(run) {
        let when = if is_first { " before anything else" } else { "" };
        hints.push(format!(
            "More iterations: this fit had {done}, the default is {usual}. Try --iterations {usual}{when}."
        ));
    } else if tenth >= 20 {
        let n = history.len();
        let (before, last) =
            (median(&history.loss[n - 2 * tenth..n - tenth]), median(&history.loss[n - tenth..]));
        if last < before * (1.0 - FALLING) {
            hints.push(format!(
                "More iterations: the loss still falls, by {:.1} % over the last tenth of the fit. Try --iterations {}.",
                100.0 * (1.0 - last / before),
                2 * n
            ));
        }
    }
    let most = run.settings.get("max_gaussians").and_then(serde_json::Value::as_u64);
    if let Some(most) = most.filter(|&m| size as u64 * 100 >= m * 98) {
        hints.push(format!(
            "More Gaussians: the limit of {most} is reached. Try --max-gaussians {}.",
            most.saturating_mul(2)
        ));
    }
    hints
}

/// The list of hints; `None` if no rule applies. `photos` is the number of photos that were fitted, where more could be taken.
pub(super) fn section(
    views: &[View<'_>],
    run: &Run<'_>,
    size: usize,
    photos: Option<usize>,
) -> Option<Section> {
    let mut hints: Vec<String> = on_photos(run, photos, !views.is_empty()).into_iter().collect();
    hints.extend(on_course(run, size, hints.is_empty()));
    if !views.is_empty() {
        hints.extend(on_views(views, short(run).is_some()));
    }
    if hints.is_empty() {
        return None;
    }
    Some(Section {
        id: "hints",
        title: "What to try",
        lead: "Simple rules on the scores and on the loss; they can be wrong.".into(),
        body: html! { ul.hints { @for hint in &hints { li { (hint) } } } },
    })
}

/// Distances between cameras, in units of the median distance from a fitted camera to the nearest other one.
pub(crate) fn distances(fitted: &[[f32; 3]], scored: &[[f32; 3]]) -> Vec<f64> {
    let far = |a: &[f32; 3], b: &[f32; 3]| {
        (0..3)
            .fold(0.0, |s, k| s + (f64::from(a[k]) - f64::from(b[k])) * (f64::from(a[k]) - f64::from(b[k])))
            .sqrt()
    };
    let nearest = |at: &[f32; 3], skip: Option<usize>| {
        let others = fitted.iter().enumerate().filter(|(i, _)| Some(*i) != skip);
        others.fold(f64::INFINITY, |m, (_, c)| order::min(m, far(at, c)))
    };
    let mut usual: Vec<f64> = fitted.iter().enumerate().map(|(i, c)| nearest(c, Some(i))).collect();
    usual.sort_by(f64::total_cmp);
    let unit = usual.get(usual.len() / 2).copied().unwrap_or(f64::INFINITY);
    let in_units = |d: f64| if unit > 0.0 && unit.is_finite() { d / unit } else { 1.0 };
    scored.iter().map(|c| in_units(nearest(c, None))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::training::History;
    use serde_json::json;

    fn hints(views: &[View<'_>], loss: Vec<f32>, size: usize) -> String {
        hints_beside(None, views, loss, size)
    }

    fn hints_beside(usual: Option<usize>, views: &[View<'_>], loss: Vec<f32>, size: usize) -> String {
        let settings = json!({"max_gaussians": 100});
        let history = History { size: vec![1; loss.len()], loss };
        let run = Run {
            settings: &settings,
            defaults: usual.map(|n| json!({ "iterations": n })),
            history: Some(&history),
            film: None,
            time: vec![],
            total_seconds: 1.0,
            files: vec![],
        };
        section(views, &run, size, None).map_or(String::new(), |s| s.body.into_string())
    }

    #[test]
    fn each_rule_needs_its_observation() {
        let (gray, dark) = (vec![0.5_f32; 12], vec![0.4_f32; 12]);
        let view = |name, psnr_db, image, distance| View { name, psnr_db, photo: &gray, image, distance };
        let even = [view("a", 30.0, &gray, Some(1.0)), view("b", 31.0, &gray, Some(5.0))];
        assert_eq!(hints(&even, vec![0.1; 400], 50), "", "nothing to say");
        let far = [view("a", 30.0, &gray, Some(1.0)), view("b", 20.0, &gray, Some(5.0))];
        assert!(hints(&far, vec![], 50).contains("Badly covered: b"), "far from the fitted cameras");
        let low = [view("a", 30.0, &gray, Some(1.0)), view("b", 20.0, &gray, None)];
        assert!(hints(&low, vec![], 50).contains("Low scores: b"), "not known to be far");
        let bright = [view("a", 30.0, &dark, None)];
        assert!(hints(&bright, vec![], 50).contains("Brightness: in a"), "the render is darker");
        let falling: Vec<f32> = (0..400).map(|i| 1.0 / (1.0 + i as f32)).collect();
        assert!(hints(&[], falling, 50).contains("--iterations 800"), "the loss still falls");
        assert!(hints(&[], vec![0.1; 400], 100).contains("--max-gaussians 200"), "no room");
    }

    #[test]
    fn a_short_fit_needs_iterations_first() {
        let (gray, dark) = (vec![0.5_f32; 12], vec![0.4_f32; 12]);
        let view = |name, psnr_db| View { name, psnr_db, photo: &gray, image: &dark, distance: None };
        let views = [view("a", 30.0), view("b", 20.0)];
        let of = |usual| hints_beside(Some(usual), &views, vec![0.1; 400], 50);
        let text = of(7000);
        assert!(
            text.starts_with("<ul class=\"hints\"><li>More iterations: this fit had 400"),
            "first: {text}"
        );
        assert!(text.contains("--iterations 7000") && text.contains("Low scores: b"), "{text}");
        assert!(!text.contains("Brightness"), "not reached yet: {text}");
        let text = of(700);
        assert!(!text.contains("More iterations") && text.contains("Brightness: in a, b"), "{text}");
    }

    #[test]
    fn few_photos_or_a_falling_score_need_photos_first() {
        use crate::report::film::{Film, Snapshot};
        let (gray, settings) = (vec![0.5_f32; 12], json!({"max_gaussians": 100}));
        let views = [View { name: "a", psnr_db: 16.0, photo: &gray, image: &gray, distance: None }];
        let of = |photos, scores: &[f64]| {
            let loss: Vec<f32> = (0..400).map(|i| 1.0 / (1.0 + i as f32)).collect();
            let history = History { size: vec![1; loss.len()], loss };
            let shot = |(k, &psnr_db): (usize, &f64)| Snapshot { iteration: 100 * k, psnr_db, image: None };
            let film = Film { all: scores.iter().enumerate().map(shot).collect(), ..Film::default() };
            let run = Run {
                settings: &settings,
                defaults: Some(json!({ "iterations": 7000 })),
                history: Some(&history),
                film: Some(&film),
                time: vec![],
                total_seconds: 1.0,
                files: vec![],
            };
            section(&views, &run, 100, photos).map_or(String::new(), |s| s.body.into_string())
        };
        let rises = [10.0, 14.0, 15.0, 15.5, 16.0];
        let falls = [10.0, 14.0, 18.0, 17.0, 16.0];
        let text = of(Some(12), &rises);
        assert!(text.starts_with("<ul class=\"hints\"><li>More photos: this fit had 12 training"), "{text}");
        assert!(text.contains("60 to 200") && text.contains("full orbit"), "how many: {text}");
        let [photos, iterations, gaussians] = ["More photos", "--iterations 7000.", "More Gaussians"]
            .map(|part| text.find(part).expect("a hint"));
        assert!(photos < iterations && iterations < gaussians, "the order: {text}");
        let text = of(Some(40), &falls);
        assert!(
            text.starts_with("<ul class=\"hints\"><li>More photos: the held-out PSNR fell from 18.0 dB (iteration 200) to 16.0 dB"),
            "{text}"
        );
        assert!(!of(Some(40), &rises).contains("More photos"), "enough photos, and the score rises");
        assert!(!of(None, &falls).contains("More photos"), "no photos can be taken");
    }

    #[test]
    fn distances_are_in_units_of_the_usual_one() {
        let fitted: Vec<[f32; 3]> = (0..5).map(|i| [i as f32 * 2.0, 0.0, 0.0]).collect();
        assert_eq!(
            distances(&fitted, &[[1.0, 0.0, 0.0], [14.0, 0.0, 0.0]]),
            [0.5, 3.0],
            "nearest fitted camera"
        );
        assert_eq!(distances(&fitted[..1], &[[1.0, 0.0, 0.0]]), [1.0], "one camera has no usual distance");
    }
}
