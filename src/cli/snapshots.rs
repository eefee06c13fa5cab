//! Snapshots of a training: the render of one view and the PSNR of a few at some iterations, for the report.
//!
//! They are made between iterations from a state that they cannot change, so results and digests do not depend on them. Their number is
//! limited so that they cost about 2 % of the time of a training. They are files of the folder of the training, `snapshots/`, from which a
//! resumed training reads those before it.

use crate::fit::training::{Fit, Step, Watch};
use crate::io::image_file::Samples;
use crate::io::{atomic, image_file};
use crate::meter::Meter;
use crate::report::film::{Film, Snapshot};
use crate::report::images;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Iterations whose render is kept, besides the last one.
const KEPT: [usize; 11] = [0, 50, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000];
/// Most places of the curve of the PSNR, besides those.
const PLACES: usize = 12;
/// Most views of a place.
const VIEWS: usize = 2;
/// Iterations of the fit for each view that is rendered for the curve: an iteration costs at least two renders.
const ITERATIONS_PER_RENDER: usize = 50;
/// The folder in the folder of a training.
const FOLDER: &str = "snapshots";
/// The table in that folder.
const TABLE: &str = "psnr.csv";

/// Number of places of the curve and of views of a place, for a training of that length.
fn extent(total: usize) -> [usize; 2] {
    let renders = total / ITERATIONS_PER_RENDER;
    let places = renders.clamp(1, PLACES);
    [places, (renders / places).clamp(1, VIEWS)]
}

/// Whether a snapshot is made after `done` of `total` iterations, and whether its image is kept.
fn is_due(done: usize, total: usize) -> (bool, bool) {
    let [places, _] = extent(total);
    let kept = done == total || KEPT.contains(&done);
    // Crosses a multiple of total / places.
    let place = done > 0 && done * places / total != (done - 1) * places / total;
    (kept || place, kept)
}

/// Progress and snapshots.
pub(crate) struct Recorder<'a> {
    meter: &'a mut Meter,
    dir: PathBuf,
    film: Film,
}

impl<'a> Recorder<'a> {
    /// A recorder without snapshots; `dir` is the folder of the training.
    pub(crate) fn new(meter: &'a mut Meter, dir: &Path) -> Self {
        Self { meter, dir: dir.join(FOLDER), film: Film::default() }
    }

    /// The snapshots.
    pub(crate) fn into_film(self) -> Film {
        self.film
    }

    /// Reads the snapshots of a training that is resumed after `done` iterations. What is missing or damaged is left out: the report has less to show.
    pub(crate) fn resume(&mut self, done: usize) {
        let dir = &self.dir;
        let text = std::fs::read_to_string(dir.join(TABLE)).unwrap_or_default();
        let read = |line: &str| {
            let [iteration, psnr, views, metric, view] =
                line.splitn(5, ',').collect::<Vec<_>>().try_into().ok()?;
            let iteration: usize = iteration.parse().ok()?;
            let head = (views.parse().ok()?, metric.to_owned(), view.to_owned());
            let image = read_image(&dir.join(file(iteration)));
            Some((head, Snapshot { iteration, psnr_db: psnr.parse().ok()?, image }))
        };
        for (head, snapshot) in text.lines().skip(1).filter_map(read).filter(|(_, s)| s.iteration <= done) {
            (self.film.views, self.film.metric, self.film.view) = head;
            self.film.all.push(snapshot);
        }
    }

    /// Makes a snapshot if it is time for one.
    fn at(&mut self, done: usize, total: usize, fit: &dyn Fit) -> Result<bool> {
        let (due, kept) = is_due(done, total);
        if !due || self.film.all.last().is_some_and(|s| s.iteration >= done) {
            return Ok(false);
        }
        let [_, views] = extent(total);
        let mut levels = Vec::new();
        let mut image = None;
        for k in 0..views {
            let Some(preview) = fit.preview(k, views) else { break };
            levels.push(preview.psnr_db);
            if k == 0 {
                (self.film.view, self.film.metric) = (preview.name, preview.metric.to_owned());
                image = kept.then(|| images::small(preview.image, preview.size, images::MAX_STRIP_SIDE));
            }
        }
        if levels.is_empty() {
            return Ok(false);
        }
        self.film.views = levels.len();
        let psnr_db = levels.iter().fold(0.0, |s, x| s + x) / levels.len() as f64;
        self.film.all.push(Snapshot { iteration: done, psnr_db, image });
        // Before the checkpoint of this iteration, so that a resumed training has every snapshot up to it.
        self.write()?;
        Ok(true)
    }

    /// Writes the table, and the image of the newest snapshot if it has one.
    fn write(&self) -> Result<()> {
        let (dir, Some(last)) = (&self.dir, self.film.all.last()) else { return Ok(()) };
        std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
        if let Some((rgb, [w, h])) = &last.image {
            image_file::write_png(&dir.join(file(last.iteration)), *w, *h, 3, &image_file::to_u8(rgb)?)?;
        }
        let Film { view, metric, views, all } = &self.film;
        let rows = all.iter().map(|s| format!("{},{},{views},{metric},{view}\n", s.iteration, s.psnr_db));
        let table = format!("iteration,psnr_db,views,metric,view\n{}", rows.collect::<String>());
        atomic::write_bytes(&dir.join(TABLE), table.as_bytes())
    }
}

/// An image of the folder: (H, W, 3) and W, H.
fn read_image(path: &Path) -> Option<(Vec<f32>, [usize; 2])> {
    let picture = image_file::read(path).ok()?;
    let Samples::U8(bytes) = picture.samples else { return None };
    let rgb = bytes.iter().map(|&b| f32::from(b) / 255.0).collect();
    (picture.channels.len() == 3).then_some((rgb, [picture.width, picture.height]))
}

/// The image of an iteration.
fn file(iteration: usize) -> String {
    format!("{iteration:06}.png")
}

impl Watch for Recorder<'_> {
    fn lap(&mut self, part: &'static str) {
        self.meter.lap(part);
    }

    fn progress(&mut self, done: usize, total: usize, step: Step) {
        self.meter.progress(done, total, step);
    }

    fn is_checkpoint_due(&mut self) -> bool {
        self.meter.is_checkpoint_due()
    }

    fn state(&mut self, done: usize, total: usize, fit: &dyn Fit) -> Result<()> {
        if self.at(done, total, fit)? {
            self.meter.lap("snapshots");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checkpoints_by_time_stay_due() {
        let mut meter = Meter::with_checkpoint_due();
        assert!(Recorder::new(&mut meter, Path::new("")).is_checkpoint_due(), "as the stopwatch has it");
        let mut meter = Meter::new();
        assert!(!Recorder::new(&mut meter, Path::new("")).is_checkpoint_due(), "a new one");
    }

    #[test]
    fn snapshots_are_few_and_the_first_and_last_state_are_among_them() {
        for total in [1, 8, 60, 400, 1500, 7000, 30_000] {
            let due: Vec<usize> = (0..=total).filter(|&i| is_due(i, total).0).collect();
            let [places, views] = extent(total);
            assert!(due.first() == Some(&0) && due.last() == Some(&total), "{total}: {due:?}");
            let kept = KEPT.iter().filter(|&&i| i < total).count() + 1;
            assert!(due.len() <= places + kept, "{total}: {due:?}");
            if total >= 400 {
                let renders = due.len() * views;
                assert!(
                    renders * 50 <= total * 4,
                    "{total}: {renders} renders are at most 2 % of four per iteration"
                );
            }
        }
        assert_eq!(is_due(200, 400), (true, true), "kept");
        assert_eq!(is_due(100, 400), (true, false), "a place of the curve");
        assert_eq!(is_due(101, 400), (false, false), "neither");
    }
}
