use super::*;

/// x ← x·¾ + draw(seed, i): every step depends on the state and the iteration number.
struct Toy {
    x: Vec<f32>,
    seed: u32,
    n: usize,
}

impl Fit for Toy {
    fn kind(&self) -> &'static str {
        "toy"
    }
    fn settings(&self) -> Value {
        serde_json::json!({"iterations": self.n, "seed": self.seed})
    }
    fn iterations(&self) -> usize {
        self.n
    }
    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        for (k, x) in self.x.iter_mut().enumerate() {
            let draw = (i as u32).wrapping_mul(2_654_435_761).wrapping_add(self.seed) ^ k as u32;
            *x = *x * 0.75 + (draw >> 8) as f32 / 16_777_216.0;
        }
        watch.lap("step");
        Ok(Step { loss: self.x[0], size: self.x.len() })
    }
    fn save(&self, out: &mut Arrays) {
        out.put("x", &[self.x.len()], self.x.clone());
    }
    fn load(&mut self, from: &Arrays) -> Result<()> {
        self.x = from.need("x")?.to_f32();
        Ok(())
    }
}

/// Sets the flag when `at` iterations are complete.
struct StopAt<'a>(usize, &'a AtomicBool);
impl Watch for StopAt<'_> {
    fn progress(&mut self, done: usize, _total: usize, _step: Step) {
        self.1.store(done == self.0, Ordering::Relaxed);
    }
}

fn toy() -> Toy {
    Toy { x: vec![0.5; 3], seed: 7, n: 20 }
}

/// Requests a checkpoint after 7 iterations; records when checkpoints are written.
struct Minute {
    done: usize,
    written: Vec<usize>,
}
impl Watch for Minute {
    fn lap(&mut self, part: &'static str) {
        if part == "checkpoint" {
            self.written.push(self.done);
        }
    }
    fn progress(&mut self, done: usize, _total: usize, _step: Step) {
        self.done = done;
    }
    fn is_checkpoint_due(&mut self) -> bool {
        self.done == 7
    }
}

/// Records which states it is shown, and what they are.
#[derive(Default)]
struct Viewer(Vec<(usize, f32)>);
impl Watch for Viewer {
    fn state(&mut self, done: usize, total: usize, fit: &dyn Fit) -> Result<()> {
        assert_eq!(total, fit.iterations(), "of this fit");
        let mut arrays = Arrays::new();
        fit.save(&mut arrays);
        self.0.push((done, arrays.need("x")?.to_f32()[0]));
        Ok(())
    }
}

#[test]
fn checkpoints_come_by_time_too_and_leave_the_result_alone() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let stop = AtomicBool::new(false);
    let mut states = Vec::new();
    for (name, due) in [("counted", false), ("timed", true)] {
        let path = dir.path().join(name);
        let (mut fit, mut history) = (toy(), History::default());
        let mut watch = Minute { done: 0, written: Vec::new() };
        let schedule = Schedule { checkpoint: Some(&path), every: 6, stop: &stop };
        if due {
            run(&mut fit, &mut history, schedule, &mut watch).expect("runs");
            assert_eq!(watch.written, [6, 7, 12, 18, 20], "one more, when it was due");
        } else {
            run(&mut fit, &mut history, schedule, &mut ()).expect("runs");
        }
        states.push((fit.x, std::fs::read(&path).expect("written")));
    }
    assert_eq!(states[0], states[1], "the same bits and the same last checkpoint");
}

#[test]
fn every_state_is_shown_once_from_the_first_to_the_last() {
    let stop = AtomicBool::new(false);
    let (mut fit, mut history, mut viewer) = (toy(), History::default(), Viewer::default());
    run(&mut fit, &mut history, Schedule { checkpoint: None, every: 6, stop: &stop }, &mut viewer)
        .expect("runs");
    assert_eq!(viewer.0.iter().map(|s| s.0).collect::<Vec<_>>(), (0..=20).collect::<Vec<_>>(), "all states");
    assert_eq!(viewer.0[0].1, 0.5, "the first is that before the first iteration");
    let losses: Vec<f32> = viewer.0[1..].iter().map(|s| s.1).collect();
    assert_eq!(losses, history.loss, "each after its iteration");
}

#[test]
fn a_resumed_fit_is_the_uninterrupted_fit() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let stop = AtomicBool::new(false);
    let whole = dir.path().join("whole.safetensors");
    let (mut a, mut h) = (toy(), History::default());
    run(&mut a, &mut h, Schedule { checkpoint: Some(&whole), every: 6, stop: &stop }, &mut ()).expect("runs");
    assert_eq!(h.len(), 20, "all iterations");

    let path = dir.path().join("parts.safetensors");
    let (mut b, mut history) = (toy(), History::default());
    for at in [1, 5, 13] {
        let schedule = Schedule { checkpoint: Some(&path), every: 100, stop: &stop };
        let e = run(&mut b, &mut history, schedule, &mut StopAt(at, &stop)).expect_err("it was stopped");
        assert_eq!(e.exit_code(), 130, "{e}");
        assert!(e.to_string().contains(&format!("after iteration {at} of 20")), "{e}");
        stop.store(false, Ordering::Relaxed);
        b = toy();
        let session = Session { checkpoint: &path, every: 100 };
        assert_eq!(session.begin(&mut b, false).expect("nothing read").1, Start::Fresh, "not resumed");
        let missing = Session { checkpoint: &dir.path().join("none"), every: 100 };
        assert_eq!(missing.begin(&mut b, true).expect("nothing read").1, Start::NoCheckpoint, "no file");
        let (so_far, start) = session.begin(&mut b, true).expect("the checkpoint is complete");
        assert_eq!((so_far.len(), start), (at, Start::Resumed), "where it was stopped");
        history = so_far;
    }
    run(&mut b, &mut history, Schedule { checkpoint: Some(&path), every: 100, stop: &stop }, &mut ())
        .expect("runs");
    assert_eq!(std::fs::read(&whole).expect("written"), std::fs::read(&path).expect("written"), "same bytes");
}

#[test]
fn messages_name_the_command() {
    let names = ["splat", "last", "last tune", "last pretrain"].map(command);
    assert_eq!(names, ["splat fit", "last fit", "last tune", "last pretrain"], "of each kind");
}

#[test]
fn other_settings_and_other_files_are_refused() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    let stop = AtomicBool::new(false);
    let schedule = Schedule { checkpoint: Some(&path), every: 5, stop: &stop };
    run(&mut toy(), &mut History::default(), schedule, &mut ()).expect("runs");
    let mut other = Toy { seed: 8, ..toy() };
    let e = resume(&mut other, &path).expect_err("another seed").to_string();
    assert!(e.contains("seed: expected 7 as in the checkpoint, got 8"), "{e}");
    let full = std::fs::read(&path).expect("written");
    let mut changed = full.clone();
    *changed.last_mut().expect("not empty") ^= 1;
    std::fs::write(&path, &changed).expect("a changed array");
    let e = resume(&mut toy(), &path).expect_err("one bit of an array was changed").to_string();
    assert!(e.contains("digest of the arrays") && e.contains("was changed"), "{e}");
    std::fs::write(&path, &full[..full.len() / 2]).expect("truncated");
    assert!(resume(&mut toy(), &path).is_err(), "a truncated file is an error");
    assert!(resume(&mut toy(), &dir.path().join("none")).is_err(), "a missing file is an error");
}
