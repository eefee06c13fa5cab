//! A cursor over bytes whose errors name the file, the byte and the field.

use crate::{Error, Result};
use std::fmt::Arguments;

/// Reads fixed-size little-endian fields one after the other.
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    name: &'a str,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8], name: &'a str) -> Self {
        Self { bytes, at: 0, name }
    }

    /// Number of bytes not yet read.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// An error at the current byte.
    pub fn error(&self, what: Arguments<'_>) -> Error {
        Error::input(self.name).at(format!("byte {}: {what}", self.at))
    }

    /// The next `n` bytes.
    pub fn take(&mut self, n: usize, what: Arguments<'_>) -> Result<&'a [u8]> {
        if n > self.left() {
            let got = match self.left() {
                0 => "the end of the file".to_owned(),
                left => format!("{left} before the end of the file"),
            };
            return Err(self.error(what).expected(format!("{n} bytes")).got(got));
        }
        let out = &self.bytes[self.at..self.at + n];
        self.at += n;
        Ok(out)
    }

    pub fn array<const N: usize>(&mut self, what: Arguments<'_>) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N, what)?);
        Ok(out)
    }

    pub fn u32(&mut self, what: Arguments<'_>) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub fn i32(&mut self, what: Arguments<'_>) -> Result<i32> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    pub fn u64(&mut self, what: Arguments<'_>) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    /// A finite f64.
    pub fn f64(&mut self, what: Arguments<'_>) -> Result<f64> {
        let x = f64::from_le_bytes(self.array(what)?);
        if !x.is_finite() {
            self.at -= 8;
            return Err(self.error(what).expected("a finite number").got(x.to_string()));
        }
        Ok(x)
    }

    /// A count of records of at least `size` bytes each, checked against the bytes that are left.
    pub fn count(&mut self, size: usize, what: Arguments<'_>) -> Result<usize> {
        let n = self.u64(what)?;
        let fits = (self.left() / size) as u64;
        if n > fits {
            self.at -= 8;
            return Err(self
                .error(what)
                .expected(format!(
                    "at most {fits} records of {size} bytes or more, as the file's length allows"
                ))
                .got(n.to_string()));
        }
        usize::try_from(n).map_err(|_| {
            self.error(what).expected("a number of records this machine can hold").got(n.to_string())
        })
    }

    /// The end of the file.
    pub fn end(&self) -> Result<()> {
        if self.left() > 0 {
            return Err(self
                .error(format_args!("end"))
                .expected("the end of the file")
                .got(format!("{} more bytes", self.left())));
        }
        Ok(())
    }
}
