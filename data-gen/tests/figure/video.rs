//! Tests of a subject's video: motion, cameras.

use crate::{correlation, scm};
use data_gen::figure::mechanism::{Mechanism, variance};
use data_gen::figure::video;

#[test]
fn videos_move_smoothly_and_follow_the_model() {
    let scm = scm("FORK", 4, Mechanism::Nl, false, 2);
    let frames: Vec<_> = (0..100).map(|t| video::frame(&scm, 2, 0, t, 100)).collect();
    for j in 0..4 {
        let e: Vec<f64> = frames.iter().map(|f| f.e[j]).collect();
        assert!((variance(&e) - 1.0).abs() < 1e-12, "own cause {j} has variance 1");
        for k in 0..j {
            let other: Vec<f64> = frames.iter().map(|f| f.e[k]).collect();
            assert!(correlation(&e, &other).abs() < 1e-12, "own causes {j} and {k} are uncorrelated");
        }
        let jump = (0..100).fold(0.0, |worst: f64, t| {
            let d = (e[(t + 1) % 100] - e[t]).abs();
            if d > worst { d } else { worst }
        });
        // Harmonics up to 8 of the clip: 2π (4 + 8)/100.
        assert!(jump < 0.76, "own cause {j} jumps by {jump}");
    }
    for f in &frames {
        assert_eq!(f.u, scm.factors(&f.e, None), "factors follow");
    }
    // Frequencies of one cycle per frame and more alias to lower ones.
    for (n, t, is_exact) in [(4, 20, true), (6, 20, false), (6, 25, true), (4, 16, false)] {
        assert_eq!(video::is_balanced(n, t), is_exact, "{n} factors in {t} frames");
        let scm = self::scm("EMPTY", n, Mechanism::Lin, true, 3);
        for j in (0..n).filter(|_| is_exact) {
            let e: Vec<f64> = (0..t).map(|k| video::frame(&scm, 3, 1, k, t).e[j]).collect();
            assert!((variance(&e) - 1.0).abs() < 1e-12, "{n} factors in {t} frames: own cause {j}");
        }
    }
    let other = video::frame(&scm, 2, 1, 7, 100);
    assert!(other.e != frames[7].e, "subjects move differently");
    assert_eq!(video::test_cameras(22), (1..=22).collect::<Vec<_>>(), "all test cameras");
    assert_eq!(video::test_cameras(4), [3, 9, 14, 20], "spread");
    let camera = video::camera(0, 64);
    // The front of the figure faces the training camera: the depth of (0, −1, 0) is smaller than that of (0,
    // 1, 0).
    let m = camera.view_from_world;
    assert!(m[9] > 0.9, "the viewing direction is +y");
}
