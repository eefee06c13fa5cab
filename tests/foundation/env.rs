//! The probe refuses threads whose floating-point environment is not the default one.
#![allow(
    unsafe_code,
    reason = "setting the control register of a thread, which the library itself never does"
)]

#[cfg(target_arch = "x86_64")]
mod x86_64 {
    use lastlight::error::Kind;
    use lastlight::num::{env, par};
    use std::arch::asm;

    const DENORMALS_ARE_ZERO: u32 = 1 << 6;
    const FLUSH_TO_ZERO: u32 = 1 << 15;
    const ROUND_DOWN: u32 = 1 << 13;
    const ROUND_UP: u32 = 2 << 13;
    const ROUND_TO_ZERO: u32 = 3 << 13;

    fn read() -> u32 {
        let mut word = 0_u32;
        // SAFETY: stores the control register to a local variable.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack)) };
        word
    }

    fn write(word: u32) {
        // SAFETY: loads the control register of this thread; only defined bits are set, exceptions stay
        // masked.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack, readonly)) };
    }

    /// Runs `f` in a thread of its own with the given bits set.
    fn with_bits<T: Send>(bits: u32, f: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|s| {
            let run = || {
                let before = read();
                write(before | bits);
                let out = f();
                write(before);
                out
            };
            s.spawn(run).join().expect("the thread does not panic")
        })
    }

    #[test]
    fn the_default_environment_passes() {
        env::probe().expect("a fresh thread has the default environment");
        with_bits(0, env::probe).expect("so has this one");
    }

    #[test]
    fn every_changed_environment_is_a_typed_error_that_names_it() {
        for (bits, name) in [
            (FLUSH_TO_ZERO, "flush-to-zero"),
            (DENORMALS_ARE_ZERO, "denormals-are-zero"),
            (FLUSH_TO_ZERO | DENORMALS_ARE_ZERO, "denormals-are-zero and flush-to-zero"),
            (ROUND_DOWN, "rounding mode"),
            (ROUND_UP, "rounding mode"),
            (ROUND_TO_ZERO, "rounding mode"),
        ] {
            let e = with_bits(bits, env::probe).expect_err("the probe sees the change");
            assert_eq!(e.kind(), Kind::Input);
            let text = e.to_string();
            assert!(text.contains(name) && text.contains("fast-math"), "{bits:#x}: {text}");
        }
    }

    /// Threads inherit the register of the one that starts them: a pool started from a bad thread is refused.
    #[test]
    fn a_pool_with_a_bad_worker_is_refused_before_it_computes() {
        let mut ran = false;
        let verdict = with_bits(FLUSH_TO_ZERO, || par::with_threads(2, || ran = true));
        assert!(verdict.is_err(), "the workers inherited flush-to-zero");
        assert!(!ran, "nothing was computed");
    }
}
