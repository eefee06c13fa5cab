//! What a training shows while it runs: an object of another seed from a camera whose image the model has not
//! read.

use super::source::Source;
use super::stage::VIEWS;
use crate::Result;
use crate::fit::evaluate::compare;
use crate::fit::field::targets::target;
use crate::fit::field::{Target, view};
use crate::fit::training::Preview;
use crate::lirm::r#gen::Version;
use crate::lirm::model::config::Config;
use crate::lirm::model::decode::Rendering;
use crate::lirm::model::transformer::Input;
use crate::lirm::model::weights::Ready;
use crate::lirm::reading::INPUT_SIDE;
use crate::num::elem::f64 as elem;
use crate::scene::field::Placement;

/// Objects.
pub(super) const COUNT: usize = 2;
/// Images that the model reads.
const READ: usize = 4;

/// One object.
#[derive(Debug)]
pub(super) struct PreviewObject {
    name: String,
    inputs: Vec<Input>,
    target: Target,
    placement: Placement,
}

impl PreviewObject {
    /// Makes object `k`: four images that are spread around it, and one between them.
    pub(super) fn new(of: &dyn Source, k: u64, version: Version, config: &Config) -> Result<Self> {
        let small = of.object(k, version)?.sized(INPUT_SIDE)?;
        let angle = |i: usize| {
            let [x, y, _] = small.all[i].picture.camera.center();
            elem::atan2(f64::from(y), f64::from(x))
        };
        let mut around: Vec<usize> = (0..VIEWS).collect();
        around.sort_by(|a, b| angle(*a).total_cmp(&angle(*b)).then(a.cmp(b)));
        let which: Vec<usize> = (0..READ).map(|i| around[i * VIEWS / READ]).collect();
        let placement = small.posed(config.pose, &which)?;
        let read = which.iter().map(|i| &small.all[*i]);
        let target = target(&small.all[around[VIEWS / (2 * READ)]].picture, &placement);
        Ok(Self {
            name: format!("{} of object {k}", target.name),
            inputs: read.map(|view| Input::of(view, &placement, config)).collect(),
            target,
            placement,
        })
    }

    /// The target as the model sees it.
    pub(super) fn preview(&self, ready: &Ready<'_>, rendering: Rendering) -> Option<Preview> {
        let (state, _) = ready.read(&ready.no_state(), &self.inputs, None);
        let field = ready.decode(&state, rendering, self.placement);
        let camera = &self.target.camera;
        let image = view::render(&field, None, camera, false).color()?;
        let size = [camera.height, camera.width];
        let colored = self.target.colored.as_deref();
        let scored = compare(&self.target.name, &image, &self.target.color, colored, size).ok()?;
        let size = [size[1], size[0]];
        Some(Preview { name: self.name.clone(), image, size, psnr_db: scored.score.psnr_db, metric: "PSNR" })
    }
}
