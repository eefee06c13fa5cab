//! PyTorch in a process of its own, which runs on request and waits otherwise.

use lastlight::io::npz;
use lastlight::num::array::Arrays;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

pub(super) struct Peer {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    file: PathBuf,
}

impl Peer {
    /// Starts `peer.py` with these arrays; none if PyTorch cannot be imported.
    pub(super) fn start(arrays: &Arrays, threads: usize) -> Option<Self> {
        let file = std::env::temp_dir().join(format!("block-{}.npz", std::process::id()));
        npz::write(&file, arrays).expect("the temporary folder can be written to");
        let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/block/peer.py");
        let mut child = Command::new(python)
            .arg(script)
            .arg(&file)
            .arg(threads.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .ok()?;
        let (to, from) = (child.stdin.take()?, BufReader::new(child.stdout.take()?));
        let mut peer = Self { child, to, from, file };
        peer.try_answer("forward").map(|_| peer)
    }

    fn try_answer(&mut self, command: &str) -> Option<String> {
        writeln!(self.to, "{command}").ok()?;
        let mut line = String::new();
        self.from.read_line(&mut line).ok().filter(|n| *n > 0)?;
        Some(line.trim().to_owned())
    }

    /// Its answer to a command.
    pub(super) fn answer(&mut self, command: &str) -> String {
        self.try_answer(command).expect("the peer runs")
    }

    /// Its answer to a command whose answer is a number.
    pub(super) fn number(&mut self, command: &str) -> f64 {
        self.answer(command).parse().expect("a number")
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.file);
    }
}
