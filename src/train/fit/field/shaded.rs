//! Materials from images alone: surface points are shaded under a light, and compared with the image (§ 10b).
//!
//! Of the valid rays 512 are drawn per iteration. Their numerical normal, albedo, roughness and metallic are shaded by
//! `shade.envmap` under a map of 16×32 texels, known or learned (softplus of free parameters): direct light, without
//! shadows and without light from other surfaces. The result is encoded and compared as colours are; the mean
//! albedo is pulled towards ½, and a learned light is smooth.

use super::adding::add as add_to;
use super::losses::Rendered;
use super::state::LIGHT;
use crate::Result;
use crate::loss::variation::{self, Columns};
use crate::loss::{In, mse};
use crate::nn::{linear, softplus};
use crate::num::rng::Rng;
use crate::scene::light::Environment;
use crate::shade::environment::solid_angles;
use crate::shade::ggx::InBar;
use crate::shade::{decode, encode, envmap};

/// Rays shaded per iteration.
const RAYS: usize = 512;
/// Purpose of drawing them; the item is the place in the list.
const PURPOSE: u16 = 0x0535;
/// Factor of squares of values in 0..1 for values in −1..1.
const WIDE: f32 = 4.0;
/// Weight of the mean albedo's distance from ½.
const GREY: f32 = 1e-3;
/// Weight of the variation of a learned light.
const SMOOTH: f32 = 1e-3;

/// Returns a map of 16×32 texels: means over solid angle, times a factor.
pub fn reduced(map: &Environment, factor: f32) -> Vec<[f32; 3]> {
    let [rows, columns] = LIGHT;
    let (omega, _) = solid_angles(map.width, map.height);
    let mut sums = vec![([0.0_f64; 3], 0.0_f64); rows * columns];
    // A texel belongs to the cell in which its centre is; maps with fewer texels than cells are read per cell.
    if map.width >= columns && map.height >= rows {
        for (i, texel) in map.radiance.iter().enumerate() {
            let (y, x) = (i / map.width, i % map.width);
            let cell =
                (2 * y + 1) * rows / (2 * map.height) * columns + (2 * x + 1) * columns / (2 * map.width);
            let (sum, weight) = &mut sums[cell];
            (0..3).for_each(|k| sum[k] += omega[y] * f64::from(texel[k]));
            *weight += omega[y];
        }
    } else {
        for (cell, (sum, weight)) in sums.iter_mut().enumerate() {
            let (y, x) = (cell / columns * map.height / rows, cell % columns * map.width / columns);
            *sum = map.radiance[y * map.width + x].map(f64::from);
            *weight = 1.0;
        }
    }
    sums.into_iter().map(|(sum, weight)| sum.map(|s| (s / weight) as f32 * factor)).collect()
}

/// The valid rays of an iteration.
pub(super) struct Valid<'a> {
    /// Indices among all rays.
    pub(super) rays: &'a [usize],
    /// Their numerical normals.
    pub(super) normals: &'a [[f32; 3]],
    /// Directions of all rays.
    pub(super) directions: &'a [[f32; 3]],
    /// Colours of the images at all rays, (N, 3).
    pub(super) colors: &'a [f32],
}

/// Where the light comes from.
pub(super) enum Light<'a> {
    /// A map.
    Known(&'a [[f32; 3]]),
    /// Parameters (16, 32, 3) before softplus, and their gradient.
    Learned(&'a [f32], &'a mut [f32]),
}

/// Returns the texels of learned parameters.
pub fn texels(parameters: &[f32]) -> Vec<[f32; 3]> {
    let mut values = vec![0.0; parameters.len()];
    softplus::forward(parameters, &mut values);
    values.as_chunks::<3>().0.to_vec()
}

/// Adds the cotangents of shaded rays to those of albedo and material in `out` and of normals in `normals_bar`; returns the
/// loss.
pub(super) fn add(
    valid: &Valid<'_>,
    light: Light<'_>,
    (seed, iteration): (u64, usize),
    out: &mut Rendered<'_>,
    normals_bar: &mut [[f32; 3]],
) -> Result<f32> {
    let (Some(albedo_at), Some(material_at)) = (out.channels.albedo, out.channels.material) else {
        return Ok(0.0);
    };
    let n = valid.rays.len();
    if n == 0 {
        return Ok(0.0);
    }
    let rng = Rng::new(seed);
    let step = u32::try_from(iteration).expect("validated");
    let drawn: Vec<usize> = (0..RAYS).map(|i| rng.index(n, i as u64, step, PURPOSE, 0)).collect();
    let rays: Vec<usize> = drawn.iter().map(|i| valid.rays[*i]).collect();
    let at_rays = || rays.iter().copied();
    let encoded = out.picked(at_rays(), albedo_at, 3);
    let mut linear = vec![0.0; encoded.len()];
    decode::forward(&encoded, &mut linear);
    let normal: Vec<[f32; 3]> = drawn.iter().map(|i| valid.normals[*i]).collect();
    let view: Vec<[f32; 3]> = rays.iter().map(|r| valid.directions[*r].map(|x| -x)).collect();
    let roughness = out.picked(at_rays(), material_at, 1);
    let metallic = out.picked(at_rays(), material_at + 1, 1);
    let learned = match &light {
        Light::Learned(parameters, _) => texels(parameters),
        Light::Known(_) => Vec::new(),
    };
    let env = match &light {
        Light::Known(map) => map,
        Light::Learned(..) => learned.as_slice(),
    };
    let x = envmap::In {
        normal: &normal,
        view: &view,
        albedo: linear.as_chunks().0,
        roughness: &roughness,
        metallic: &metallic,
        env,
        height: LIGHT[0],
        width: LIGHT[1],
    };
    let mut radiance = vec![[0.0; 3]; RAYS];
    envmap::forward(x, &mut radiance);
    let mut shaded = vec![0.0; 3 * RAYS];
    encode::forward(radiance.as_flattened(), &mut shaded);
    let colors: Vec<f32> = rays.iter().flat_map(|r| valid.colors[3 * r..3 * r + 3].to_vec()).collect();
    let pair = In { x: &shaded, y: &colors, mask: None, height: RAYS, width: 1 };
    let (value, saved) = mse::forward(&pair)?;
    let mut loss = WIDE * value;
    let mut shaded_bar = vec![0.0; shaded.len()];
    mse::adjoint(&pair, &saved, WIDE, &mut shaded_bar, None);
    let mut radiance_bar = vec![0.0; shaded.len()];
    encode::adjoint(radiance.as_flattened(), &shaded_bar, &mut radiance_bar);
    let zeros = || vec![[0.0; 3]; RAYS];
    let mut bar =
        InBar { normal: zeros(), albedo: zeros(), roughness: vec![0.0; RAYS], metallic: vec![0.0; RAYS] };
    let mut env_bar = vec![[0.0; 3]; env.len()];
    envmap::adjoint(x, radiance_bar.as_chunks().0, &mut bar, &mut env_bar);
    let mut encoded_bar = vec![0.0; encoded.len()];
    decode::adjoint(&encoded, bar.albedo.as_flattened(), &mut encoded_bar);
    if let Light::Learned(parameters, gradient) = light {
        loss += smoothness(&learned, &mut env_bar);
        softplus::adjoint(parameters, env_bar.as_flattened(), gradient);
    }
    out.put(at_rays(), albedo_at, 3, &encoded_bar);
    out.put(at_rays(), material_at, 1, &bar.roughness);
    out.put(at_rays(), material_at + 1, 1, &bar.metallic);
    for (i, part) in drawn.iter().zip(&bar.normal) {
        add_to(&mut normals_bar[*i], part);
    }
    let colors = albedo_at..albedo_at + 3;
    let channels: Vec<f32> = colors.clone().flat_map(|at| out.picked(rays.iter().copied(), at, 1)).collect();
    let (value, channels_bar) = grey(&channels)?;
    for (at, part) in colors.zip(channels_bar.chunks_exact(RAYS)) {
        out.put(at_rays(), at, 1, part);
    }
    Ok(loss + value)
}

/// The squared variation of a light's texels, whose gradient is added to `env_bar`.
fn smoothness(env: &[[f32; 3]], env_bar: &mut [[f32; 3]]) -> f32 {
    let shape = [1, LIGHT[0], LIGHT[1], 3];
    let maps = variation::In { planes: env.as_flattened(), shape, columns: Columns::Periodic };
    variation::adjoint(&maps, SMOOTH, env_bar.as_flattened_mut());
    SMOOTH * variation::forward(&maps)
}

/// The squared distance of the mean albedo (3, N) from ½, and its gradient.
fn grey(channels: &[f32]) -> Result<(f32, Vec<f32>)> {
    let n = channels.len() / 3;
    let shares = vec![1.0 / n as f32; n];
    let x = linear::In { x: &shares, weight: channels, bias: &[], m: 1, n: 3, k: n };
    let mut mean = [0.0; 3];
    linear::forward(x, &mut mean);
    let pair = In { x: &mean, y: &[0.5; 3], mask: None, height: 1, width: 1 };
    let (value, saved) = mse::forward(&pair)?;
    let mut mean_bar = [0.0; 3];
    mse::adjoint(&pair, &saved, GREY, &mut mean_bar, None);
    let mut bar = linear::InBar { weight: vec![0.0; channels.len()], ..linear::InBar::default() };
    linear::adjoint(x, &mean_bar, &mut bar);
    Ok((GREY * value, bar.weight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::sum;

    /// Σ ω L over a map, per channel.
    fn power(texels: &[[f32; 3]], width: usize, height: usize) -> [f64; 3] {
        let (omega, _) = solid_angles(width, height);
        std::array::from_fn(|k| {
            let terms: Vec<f64> =
                texels.iter().enumerate().map(|(i, x)| omega[i / width] * f64::from(x[k])).collect();
            sum::tree_f64(&terms)
        })
    }

    #[test]
    fn a_map_of_any_size_becomes_one_of_16_by_32() {
        let rng = Rng::new(5);
        for (width, height) in
            [(32, 16), (64, 32), (512, 256), (96, 48), (100, 50), (33, 17), (8, 4), (1, 1), (200, 9)]
        {
            let radiance: Vec<[f32; 3]> = (0..width * height)
                .map(|i| std::array::from_fn(|k| rng.uniform_f32(i as u64, 0, 0, k as u16)))
                .collect();
            let map = Environment { radiance, width, height };
            let small = reduced(&map, 2.0);
            assert_eq!(small.len(), 512, "{width}×{height}");
            assert!(small.as_flattened().iter().all(|x| (0.0..=2.0).contains(x)), "{width}×{height}: means");
            // cells of whole texels hold their light to the last digits
            if width % 32 == 0 && height % 16 == 0 {
                let [before, after] = [power(&map.radiance, width, height), power(&small, 32, 16)];
                for (a, b) in before.iter().zip(after) {
                    assert!(
                        (2.0 * a - b).abs() < 1e-6 * b,
                        "{width}×{height}: {a} before, {b} after, of twice"
                    );
                }
            }
        }
        let even = reduced(&Environment::constant([0.25, 0.5, 1.0]), 1.0);
        assert!(even.iter().all(|x| *x == [0.25, 0.5, 1.0]), "a constant stays constant");
    }

    #[test]
    fn the_mean_albedo_is_pulled_towards_one_half() {
        let channels = [[0.25; 4], [0.5; 4], [0.75; 4]].concat();
        let (value, bar) = grey(&channels).expect("values that count");
        assert!((value - GREY * (2.0 * 0.0625 / 3.0)).abs() < 1e-9, "{value}");
        let expected = GREY * 2.0 / 3.0 * 0.25 / 4.0;
        assert!(bar[..4].iter().all(|g| (g + expected).abs() < 1e-9), "dark: {bar:?}");
        assert!(bar[4..8].iter().all(|g| *g == 0.0), "at one half: {bar:?}");
        assert!(bar[8..].iter().all(|g| (g - expected).abs() < 1e-9), "bright: {bar:?}");
    }
}
