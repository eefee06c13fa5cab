use super::*;
use crate::fit::built_in;
use crate::fit::evaluate::{Evaluation, score};
use crate::fit::seeds::{self, Start};
use crate::fit::training::{History, Schedule, run};
use crate::splat::render;
use std::sync::atomic::AtomicBool;

fn psnr(g: &Gaussians, views: &Views) -> f64 {
    let scene = Scene::new(g, render::Settings::default(), built_in::BACKGROUND);
    let scores = views.test.iter().map(|&i| score(&scene, &views.views[i]).expect("renders").score).collect();
    Evaluation::of(scores).mean_psnr_db
}

#[test]
fn held_out_views_get_better_and_the_cap_holds() {
    let views = built_in::miniature(1, 4, &render::Settings::default()).expect("the built-in scene renders");
    let stop = AtomicBool::new(false);
    for strategy in [Strategy::Inria, Strategy::Gsplat, Strategy::GsplatAbs, Strategy::Mcmc] {
        let settings = Settings {
            iterations: 300,
            seed: 5,
            sh_degree: 1,
            strategy,
            max_gaussians: 700,
            render: render::Settings::default(),
            background: built_in::BACKGROUND,
        };
        let first =
            seeds::gaussians(&Start::Random { count: 500, bounds: None }, &views, &settings).expect("valid");
        let before = psnr(&first, &views);
        let mut fit = SplatFit::new(settings, &views, first).expect("valid");
        let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
        let mut history = History::default();
        run(&mut fit, &mut history, schedule, &mut ()).expect("runs");
        let after = psnr(fit.gaussians(), &views);
        assert!(after > before + 5.0, "{strategy:?}: {before:.2} dB to {after:.2} dB");
        assert!(history.size.iter().all(|&n| n <= 700), "{strategy:?}: at most the cap");
        let sum = |f: fn(&Event) -> usize| fit.events().iter().fold(0, |s, e| s + f(e));
        let grown = 500 + sum(|e| e.cloned) + sum(|e| e.split) + sum(|e| e.added) - sum(|e| e.pruned);
        assert_eq!(grown, fit.gaussians().len(), "{strategy:?}: the events account for every Gaussian");
    }
}

/// Evaluates every view after every iteration.
struct Viewer(Vec<f64>);
impl Watch for Viewer {
    fn state(&mut self, _done: usize, _total: usize, fit: &dyn Fit) -> Result<()> {
        self.0.extend((0..2).filter_map(|k| fit.preview(k, 2)).map(|p| p.psnr_db));
        Ok(())
    }
}

#[test]
fn previews_show_the_state_and_leave_it_alone() {
    let views = built_in::miniature(1, 4, &render::Settings::default()).expect("the built-in scene renders");
    let settings = Settings {
        iterations: 40,
        seed: 5,
        sh_degree: 1,
        strategy: Strategy::Inria,
        max_gaussians: 700,
        render: render::Settings::default(),
        background: built_in::BACKGROUND,
    };
    let first =
        seeds::gaussians(&Start::Random { count: 300, bounds: None }, &views, &settings).expect("valid");
    let stop = AtomicBool::new(false);
    let fitted = |watch: &mut dyn Watch| {
        let mut fit = SplatFit::new(settings.clone(), &views, first.clone()).expect("valid");
        let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
        run(&mut fit, &mut History::default(), schedule, watch).expect("runs");
        fit
    };
    let mut viewer = Viewer(Vec::new());
    let (watched, alone) = (fitted(&mut viewer), fitted(&mut ()));
    assert_eq!(watched.digest().expect("finite"), alone.digest().expect("finite"), "the same bits");
    let shown = watched.preview(0, 1).expect("a view");
    let scene = Scene::new(alone.gaussians(), render::Settings::default(), built_in::BACKGROUND);
    let scored = score(&scene, &views.views[views.test[0]]).expect("renders");
    assert_eq!(
        (shown.psnr_db, &shown.name),
        (scored.score.psnr_db, &scored.score.name),
        "the score of the state"
    );
    assert_eq!(shown.image, scored.image, "and its render");
    assert_eq!(
        viewer.0.len() % 41,
        0,
        "a state before the first and after each iteration: {}",
        viewer.0.len()
    );
}

#[test]
fn every_image_is_used_once_per_epoch() {
    let views = built_in::miniature(2, 8, &render::Settings::default()).expect("the built-in scene renders");
    let settings = Settings {
        iterations: 100,
        seed: 5,
        sh_degree: 0,
        strategy: Strategy::Inria,
        max_gaussians: 700,
        render: render::Settings::default(),
        background: built_in::BACKGROUND,
    };
    let first =
        seeds::gaussians(&Start::Random { count: 10, bounds: None }, &views, &settings).expect("valid");
    let mut fit = SplatFit::new(settings, &views, first).expect("valid");
    let n = views.train.len();
    let epoch =
        |fit: &mut SplatFit<'_>, e: usize| (e * n..(e + 1) * n).map(|i| fit.view_of(i)).collect::<Vec<_>>();
    let (a, b) = (epoch(&mut fit, 0), epoch(&mut fit, 1));
    assert_ne!(a, b, "another order");
    assert_eq!(epoch(&mut fit, 0), a, "the order is a function of the epoch");
    for mut order in [a, b] {
        order.sort_unstable();
        assert_eq!(order, views.train, "every training image once");
    }
}
