//! The widest registers of the processor, chosen when the program runs. The choice affects only speed: lanes are never combined, and
//! every operation is rounded as IEEE 754 defines it.

#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;
#[cfg(target_arch = "x86_64")]
use std::sync::OnceLock;

/// Returns AVX-512 support if the processor has it and it is enabled; this is determined once.
#[cfg(target_arch = "x86_64")]
pub(super) fn avx512() -> Option<V4> {
    static FOUND: OnceLock<Option<V4>> = OnceLock::new();
    let is_wanted = || std::env::var_os("LASTLIGHT_LANES").is_none_or(|lanes| lanes != "8");
    *FOUND.get_or_init(|| if is_wanted() { V4::try_new() } else { None })
}

/// Loops over sixteen numbers at a time. What `run` calls has to be inlined (`inline(always)`).
pub(super) trait Loops {
    /// Runs the loops; with `WIDE`, they are compiled for registers of sixteen lanes, of which the compiler makes use if the
    /// sixteen numbers are computed one by one, in a loop without branches.
    fn run<const WIDE: bool>(self);
}

/// Runs loops with the widest registers.
pub(super) fn widest(work: impl Loops) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = avx512() {
        return pulp::Simd::vectorize(simd, Wide(work));
    }
    work.run::<false>();
}

#[cfg(target_arch = "x86_64")]
struct Wide<W>(W);

#[cfg(target_arch = "x86_64")]
impl<W: Loops> pulp::WithSimd for Wide<W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.0.run::<true>();
    }
}
