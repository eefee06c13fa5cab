//! The box of an object from its foreground.

use crate::ball::{CENTER, RADIUS, picture};
use lastlight::fit::field::place::{around, placement, unit_ball};
use lastlight::fit::field::targets::Picture;

/// Where the cameras are directed at, as a capture has it: not the centre of the ball.
const AROUND: [f64; 3] = [0.0; 3];

fn pictures() -> Vec<Picture> {
    (0..8).map(|k| picture(k, 48)).collect()
}

#[test]
fn the_sphere_touches_the_farthest_ray_of_the_ball() {
    let pictures = pictures();
    let all: Vec<&Picture> = pictures.iter().collect();
    let [center, radius] = [CENTER.map(f64::from), [f64::from(RADIUS); 3]];
    // Around its own centre the ball has its own radius, up to a pixel.
    let own = around(&all, center).expect("a ball");
    let ratio = own.half_size / (1.05 * radius[0]);
    assert!(own.center == center && ratio > 0.93 && ratio < 1.03, "{ratio} radii");
    // Around another point the sphere reaches to the farthest point of the ball that an image can show.
    let made = around(&all, AROUND).expect("a sphere");
    let off = center.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
    let reach = made.half_size / 1.05;
    assert!(made.center == AROUND && reach > radius[0] && reach < off + 1.03 * radius[0], "{reach}, {off}");
    let at = placement(&made);
    let corner = at.to_field(std::array::from_fn(|k| made.center[k] + made.half_size));
    assert!(corner.iter().all(|x| (x - 0.525).abs() < 1e-6), "the box of the field: {corner:?}");
    // An object in the ball of radius ½ keeps its units.
    let same = placement(&unit_ball());
    assert!(same.center == [0.0; 3] && (same.scale - 1.0).abs() < 1e-7, "{same:?}");
}

#[test]
fn more_images_make_the_sphere_no_smaller() {
    let pictures = pictures();
    let half = |n: usize| {
        let some: Vec<&Picture> = pictures[..n].iter().collect();
        around(&some, AROUND).expect("a sphere").half_size
    };
    let sizes = [2, 4, 8].map(half);
    assert!(sizes[0] <= sizes[1] && sizes[1] <= sizes[2], "{sizes:?}");
}

#[test]
fn foreground_that_is_missing_or_contradicts_itself_is_refused() {
    let mut none = pictures();
    none.iter_mut().for_each(|p| p.foreground.fill(0.0));
    let e = around(&none.iter().collect::<Vec<_>>(), AROUND).expect_err("no object").to_string();
    assert!(
        e.contains("foreground") && e.contains("none in any training image") && e.contains("--box"),
        "{e}"
    );
    // One image shows nothing where the others show the ball.
    let mut torn = pictures();
    torn[3].foreground.fill(0.0);
    let e = around(&torn.iter().collect::<Vec<_>>(), AROUND).expect_err("no place").to_string();
    assert!(e.contains("no image sees as background") && e.contains("camera poses and the masks"), "{e}");
}
