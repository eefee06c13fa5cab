//! The box of an object from its foreground.

use crate::ball::{CENTER, RADIUS, picture};
use lastlight::fit::field::place::{hull, placement};
use lastlight::fit::field::targets::Picture;
use lastlight::scene::views::SceneBox;

/// Where the cameras are directed at, as a capture has it: not the centre of the ball.
const AROUND: SceneBox = SceneBox { center: [0.0; 3], half_size: 1.0 };

fn pictures() -> Vec<Picture> {
    (0..8).map(|k| picture(k, 48)).collect()
}

#[test]
fn the_box_holds_the_ball_and_little_more() {
    let pictures = pictures();
    let all: Vec<&Picture> = pictures.iter().collect();
    let made = hull(&all, &AROUND).expect("a hull");
    for k in 0..3 {
        let [center, radius] = [CENTER[k], RADIUS].map(f64::from);
        assert!((made.center[k] - center).abs() < 0.06, "axis {k}: {:?}", made.center);
        let [low, high] = [made.center[k] - made.half_size, made.center[k] + made.half_size];
        assert!(low < center - radius && high > center + radius, "axis {k}: {low} to {high}");
    }
    // Eight cones around a ball leave corners outside of it.
    let ratio = made.half_size / f64::from(RADIUS);
    assert!(ratio > 1.0 && ratio < 1.35, "{ratio} radii");
    let at = placement(&made);
    let corner = at.to_field(std::array::from_fn(|k| made.center[k] + made.half_size));
    assert!(corner.iter().all(|x| (x - 0.525).abs() < 1e-6), "the box of the field: {corner:?}");
}

#[test]
fn more_images_make_the_box_no_larger() {
    let pictures = pictures();
    let half = |n: usize| {
        let some: Vec<&Picture> = pictures[..n].iter().collect();
        hull(&some, &AROUND).expect("a hull").half_size
    };
    let sizes = [2, 4, 8].map(half);
    assert!(sizes[0] >= sizes[1] && sizes[1] >= sizes[2], "{sizes:?}");
}

#[test]
fn foreground_that_is_missing_or_contradicts_itself_is_refused() {
    let mut none = pictures();
    none.iter_mut().for_each(|p| p.foreground.fill(0.0));
    let e = hull(&none.iter().collect::<Vec<_>>(), &AROUND).expect_err("no object").to_string();
    assert!(
        e.contains("foreground") && e.contains("none in any training image") && e.contains("--box"),
        "{e}"
    );
    // One image shows nothing where the others show the ball.
    let mut torn = pictures();
    torn[3].foreground.fill(0.0);
    let e = hull(&torn.iter().collect::<Vec<_>>(), &AROUND).expect_err("no place").to_string();
    assert!(e.contains("no image sees as background") && e.contains("camera poses and the masks"), "{e}");
}
