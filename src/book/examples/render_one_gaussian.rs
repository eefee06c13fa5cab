//! Renders the scene of the chapter `one_gaussian`, prints its image to the terminal, and computes a gradient.
//!
//! `cargo run --release --example render_one_gaussian`

use lastlight::Result;
use lastlight::num::bits;
use lastlight::scene::camera::{Camera, Model};
use lastlight::splat::render::{Color, In, InBar, OutBar, Settings, Shape, adjoint, forward};

const SIDE: usize = 16;

fn main() -> Result<()> {
    let camera = Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        focal_px: [40.0, 40.0],
        center_px: [8.5, 8.5],
        width: SIDE,
        height: SIDE,
        model: Model::Pinhole,
    };
    let x = In {
        means: &[[0.0, 0.0, 4.0]],
        shape: Shape::QuatScale { quats: &[[1.0, 0.0, 0.0, 0.0]], scales: &[[0.2, 0.1, 0.1]] },
        opacities: &[0.5],
        color: Color::Rgb(&[[1.0, 0.5, 0.0]]),
        cameras: &[camera],
        background: [0.0, 0.0, 1.0],
    };
    let settings = Settings::default();
    x.validate(&settings)?;
    let (out, saved) = forward(&x, &settings);

    for row in out.alpha.chunks(SIDE) {
        let line: String = row.iter().map(|a| [' ', '.', ':', '+', '*', '#'][(a * 11.0) as usize]).collect();
        println!("{line}");
    }
    let at = 8 * SIDE + 10;
    println!("pixel (10, 8): {:?}, by hand (0.3140, 0.1570, 0.6860)", &out.image[3 * at..3 * at + 3]);
    println!("digest of the picture: {:016x}", bits::digest_f32(&[SIDE, SIDE, 3], &out.image)?);

    // The loss is the red of that pixel.
    let mut image_bar = vec![0.0; out.image.len()];
    image_bar[3 * at] = 1.0;
    let mut bar = InBar::zeros_like(&x);
    adjoint(&x, &settings, &saved, OutBar { image: Some(&image_bar), ..OutBar::default() }, &mut bar);
    println!(
        "its gradient by mean {:?}, scales {:?}, opacity {}",
        bar.means[0], bar.scales[0], bar.opacities[0]
    );
    Ok(())
}
