//! Gaussians to pictures: [`super::project`] and [`super::color`], then [`super::blend`].
//!
//! Inputs are those of the parts; instead of `sh` and `sh_degree` there may be `rgb` (N, 3), and instead of `quats` and
//! `scales` there may be `factors` (N, 3, 3). In antialiased mode the opacity of a Gaussian in a view is
//! o·compensation (`opacities_px`, (C, N)).

use crate::array::{Arr, Named, Out, expect};
use crate::scalar::Scalar;
use crate::scene::profile::Profile;
use crate::splat::{blend, color, project};

/// First stage: every Gaussian in every view, with its colour.
///
/// # Errors
/// When an input is missing or shaped otherwise, or the plan does not fit it.
pub fn project_and_color<S: Scalar>(
    x: &Named<S>,
    profile: Profile,
    plan: Option<&Named<f64>>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let views = project::Views::of(x, profile)?;
    let (n, c) = (views.n, views.cameras.len());
    let means = expect(x, "means", &[n, 3])?;
    let opacities = expect(x, "opacities", &[n])?;
    let rgb = x.contains_key("rgb").then(|| expect(x, "rgb", &[n, 3])).transpose()?;
    let sh = if rgb.is_none() { Some(color::Sh::of(x, n)?) } else { None };
    let colors = out.array("colors", &[c, n, 3]);
    let opacities_px = views.profile.antialiased.then(|| out.array("opacities_px", &[c, n]));
    let mut color_mask = Arr::filled(&[c, n, 3], 0.0);
    project::write(x, &views, plan, out, |out, c, i, row, projected| {
        let (color, mask) = match (rgb, &sh) {
            (Some(rgb), _) => (rgb.row(i), [true; 3]),
            (None, Some(sh)) => {
                let direction = color::direction(means.row(i), views.cameras[c].center());
                sh.color(i, direction, color::mask_of(plan, row))
            }
            (None, None) => unreachable!("either rgb or sh was read"),
        };
        out.put_row(colors, row, color);
        for (channel, bit) in mask.into_iter().enumerate() {
            color_mask.data[3 * row + channel] = f64::from(u8::from(bit));
        }
        if let Some(slot) = opacities_px {
            out.put(slot, row, opacities.data[i] * projected.compensation);
        }
    })?;
    out.plan.insert("color_mask".to_owned(), color_mask);
    Ok(())
}

/// Second stage: blending what the first one wrote.
///
/// # Errors
/// When an input is missing or shaped otherwise, or the plan does not fit it.
pub fn blend<S: Scalar>(
    x: &Named<S>,
    profile: &Profile,
    plan: Option<&Named<f64>>,
    out: &mut Out<S>,
) -> Result<(), String> {
    blend::forward(x, opacities_name(profile), profile, plan, out)
}

/// The array that holds the opacities blending uses.
pub fn opacities_name(profile: &Profile) -> &'static str {
    if profile.antialiased { "opacities_px" } else { "opacities" }
}
