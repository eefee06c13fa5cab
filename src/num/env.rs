//! (in work)
/// probe
pub fn probe() -> crate::Result<()> { Ok(()) }
