//! The campaign of full disks: a command writes to a small file system, or under a limit of the size of its files. It must end with an error
//! that says so, leave no half file, and go on to the result of an undisturbed run when there is room again.

use crate::long::{self, Expected, Long};
use crate::mutate::Draws;
use crate::program::{Execution, Program, stray};
use crate::table::{Finding, Report};
use crate::tree;
use std::io::Result;
use std::path::Path;
use std::process::{Command, Stdio};

/// What the draws are for, among those of a seed.
const PURPOSE: u16 = 4;

/// Columns of the table, in order.
pub const COLUMNS: [&str; 8] = [
    "trials",
    "small file system",
    "limit of file size",
    "refused",
    "done",
    "ended wrongly",
    "files left",
    "result differs",
];

/// The first column of faults.
pub const FAULTS: usize = 5;

/// Runs trials in a folder. Small file systems need the right to mount them; without `mount` every trial has a limit of file size.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a command fails where there is room.
pub fn run(
    program: &Program,
    seed: u64,
    trials: std::ops::Range<u64>,
    mount: bool,
    scratch: &Path,
) -> Result<Report> {
    long::trials(
        program,
        trials,
        false,
        scratch,
        Report::new(&COLUMNS, FAULTS),
        |n, long, expected, report| {
            let mut draws = Draws::new(seed, n, 0, PURPOSE);
            // Sizes from nearly nothing to a little more than all of it.
            let kib = 4 + (expected.bytes / 1024 * draws.below(1200) as u64) / 1000;
            let small = mount && draws.below(2) == 0;
            report.count(long.name, if small { 1 } else { 2 });
            let mut trial =
                Trial { program, long, expected, kib, threads: 1 + draws.below(3), log: Vec::new() };
            let (column, fault) = if small { trial.mounted(scratch)? } else { trial.limited(scratch)? };
            report.count(long.name, column);
            if let Some(what) = fault {
                report.add(Finding { row: long.name.into(), case: n, what, detail: trial.log.join("\n  ") });
            }
            Ok(())
        },
    )
}

/// Whether this user can mount a file system in memory.
pub fn can_mount(scratch: &Path) -> bool {
    let dir = scratch.join("probe");
    std::fs::create_dir(&dir).is_ok()
        && tmpfs(&dir, 64, false).is_ok_and(|ok| ok)
        && unmount(&dir).is_ok_and(|ok| ok)
}

fn tmpfs(dir: &Path, kib: u64, again: bool) -> Result<bool> {
    let options = format!("{}size={kib}k", if again { "remount," } else { "" });
    let mut command = Command::new("mount");
    command.args(["-t", "tmpfs", "-o", &options, "none"]).arg(dir).stderr(Stdio::null());
    command.status().map(|s| s.success())
}

fn unmount(dir: &Path) -> Result<bool> {
    Command::new("umount").arg(dir).status().map(|s| s.success())
}

type Verdict = (usize, Option<String>);

struct Trial<'a> {
    program: &'a Program,
    long: Long,
    expected: &'a Expected,
    kib: u64,
    threads: usize,
    /// what was done, for the list of faults
    log: Vec<String>,
}

impl Trial<'_> {
    /// Under a limit of the size of every file. The shell counts it in blocks of 512 bytes, some shells in KiB.
    fn limited(&mut self, scratch: &Path) -> Result<Verdict> {
        let dir = long::new_folder(scratch, "trial")?;
        let blocks = format!("&& ulimit -f {}", 1 + self.kib / 4);
        let e = self.program.run_limited(&self.long.words("out", self.threads, &[]), &dir, &blocks)?;
        self.judge(&e, &dir.join("out"), &dir)
    }

    /// On a file system of that size.
    fn mounted(&mut self, scratch: &Path) -> Result<Verdict> {
        let dir = long::new_folder(scratch, "trial")?;
        let disk = dir.join("disk");
        std::fs::create_dir(&disk)?;
        assert!(tmpfs(&disk, self.kib, false)?, "mounted before");
        let outcome = self.on_disk(&dir, &disk);
        assert!(unmount(&disk)?, "nothing uses it any more");
        outcome
    }

    fn on_disk(&mut self, dir: &Path, disk: &Path) -> Result<Verdict> {
        // The command is run beside its inputs, and writes through a link of the name it always has.
        std::os::unix::fs::symlink("disk", dir.join("here"))?;
        let e = self.program.run(&self.long.words("disk/out", self.threads, &[]), dir)?;
        let full = self.judge_first(&e, &disk.join("out"), disk)?;
        if full.1.is_some() || full.0 == DONE {
            return Ok(full);
        }
        assert!(tmpfs(disk, 1 << 18, true)?, "enlarged");
        self.go_on("disk/out", dir, &disk.join("out"))
    }

    fn judge(&mut self, e: &Execution, out: &Path, dir: &Path) -> Result<Verdict> {
        let full = self.judge_first(e, out, dir)?;
        if full.1.is_some() || full.0 == DONE { Ok(full) } else { self.go_on("out", dir, out) }
    }

    /// The run without room: done all the same, or one line of error and only whole files.
    fn judge_first(&mut self, e: &Execution, out: &Path, dir: &Path) -> Result<Verdict> {
        self.log.push(format!("{} KiB, {} threads: {}: {}", self.kib, self.threads, e.ended(), e.text()));
        if e.status.success() {
            return Ok((DONE, None));
        }
        if e.status.code() != Some(2) {
            return Ok((5, Some(e.ended())));
        }
        if let Some(what) = long::bad_message(e) {
            return Ok((5, Some(what)));
        }
        if let Some(n) = stray(&tree::read(dir)?) {
            return Ok((6, Some(format!("it left {n}"))));
        }
        for (name, bytes) in long::result(out)? {
            // A checkpoint and the table of snapshots are of the iteration at which there was still room; going on
            // tells whether they are complete.
            if !name.ends_with("checkpoint.safetensors")
                && !name.ends_with("psnr.csv")
                && self.expected.files.get(&name).is_some_and(|x| *x != bytes)
                && !name.ends_with(".json")
            {
                return Ok((6, Some(format!("{name} is not what it becomes"))));
            }
        }
        Ok((REFUSED, None))
    }

    /// With room again.
    fn go_on(&mut self, to: &str, dir: &Path, out: &Path) -> Result<Verdict> {
        let e = self.program.run(&self.long.again(to, self.threads), dir)?;
        let mut expected = self.expected.clone();
        if to != "out" {
            // The command line is in some files.
            expected.files = long::result(out)?;
        }
        let wrong = long::wrong(&e, out, &expected)?;
        self.log.push(format!("again: {}", e.ended()));
        Ok(wrong.map_or((REFUSED, None), |what| (7, Some(what))))
    }
}

const REFUSED: usize = 3;
const DONE: usize = 4;
