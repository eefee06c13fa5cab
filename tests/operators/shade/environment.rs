//! The environment as a light: densities, draws, look-ups.

use super::{on_sphere, uniform};
use lastlight::num::lanes::f32x8;
use lastlight::num::rng::Rng;
use lastlight::scene::light::Environment;
use lastlight::shade::environment::{LUMINANCE, Sky, solid_angles, texel_center, texel_centers};
use lastlight::shade::envmap;
use lastlight::shade::vector::dot;
use std::f64::consts::PI;

/// A map whose texels differ by factors of thousands, some of them black.
fn uneven(width: usize, height: usize) -> Environment {
    let radiance = (0..width * height)
        .map(|i| {
            let u = uniform(i, 20);
            let bright = if u < 0.3 { 0.0 } else { u * u * u * u };
            let bright = if i % 37 == 5 { 60.0 * bright } else { bright };
            [bright, 0.5 * bright, 2.0 * bright * uniform(i, 21)]
        })
        .collect();
    Environment { width, height, radiance }
}

fn word(item: usize) -> u64 {
    let b = Rng::new(9).block(item as u64, 0, 0x0502, 0);
    u64::from(b[1]) << 32 | u64::from(b[0])
}

#[test]
fn densities_integrate_to_one_and_are_those_of_the_table() {
    for (w, h) in [(2, 1), (1, 1), (16, 8), (7, 5), (1024, 512)] {
        let map = uneven(w, h);
        let sky = Sky::new(&map);
        let p = if sky.is_black() {
            Sky::new(&Environment::constant([1.0; 3])).probabilities()
        } else {
            sky.probabilities()
        };
        let total = p.iter().fold(0.0, |a, b| a + b);
        assert!((total - 1.0).abs() <= 1e-12, "{w}×{h}: Σ p dω = {total}");
        if sky.is_black() {
            continue;
        }
        let omega = solid_angles(w, h).0;
        assert!(
            (omega.iter().fold(0.0, |a, b| a + b * w as f64) - 4.0 * PI).abs() <= 1e-12,
            "{w}×{h}: the solid angles are the sphere"
        );
        for t in 0..w * h {
            let density = f64::from(sky.density(texel_center(w, h, t / w, t % w)));
            let gap = (density * omega[t / w] - p[t]).abs();
            assert!(
                gap <= 1e-7 * p[t] + 1e-14,
                "{w}×{h}, texel {t}: density {density}, probability {}",
                p[t]
            );
        }
    }
}

/// Bins four times finer than the texels both ways: texels are chosen by weight, and filled uniformly.
#[test]
fn draws_follow_their_density() {
    let (w, h, fine) = (16, 8, 4);
    let map = uneven(w, h);
    let sky = Sky::new(&map);
    let p = sky.probabilities();
    let (coarse, _) = solid_angles(w, h);
    let (omega, _) = solid_angles(w * fine, h * fine);
    let n = 400_000;
    let mut count = vec![0_u32; w * h * fine * fine];
    let fine_map = uneven(w * fine, h * fine);
    let ruler = Sky::new(&fine_map);
    for i in 0..n {
        let d = sky.draw(word(i), [uniform(i, 30), uniform(i, 31)]).expect("not black");
        assert!((dot(d.towards, d.towards) - 1.0).abs() < 1e-6, "unit");
        assert!(d.towards[2].abs() < 1.0, "never the pole: {:?}", d.towards);
        count[ruler.cell_of(d.towards)] += 1;
    }
    let (mut chi2, mut bins) = (0.0, 0);
    for (b, &c) in count.iter().enumerate() {
        let (i, j) = (b / (w * fine), b % (w * fine));
        let expected = p[i / fine * w + j / fine] * omega[i] / coarse[i / fine] * f64::from(n as u32);
        if expected >= 5.0 {
            let gap = f64::from(c) - expected;
            chi2 += gap * gap / expected;
            bins += 1;
        }
    }
    let (freedom, spread) = (f64::from(bins - 1), (2.0 * f64::from(bins - 1)).sqrt());
    println!("χ² = {chi2:.0} over {bins} bins: {:.2} standard deviations", (chi2 - freedom) / spread);
    assert!((chi2 - freedom).abs() <= 4.0 * spread, "χ² = {chi2} with {freedom} degrees of freedom");
    assert!(bins > 1000, "{bins} bins are filled");
}

#[test]
fn one_texel_at_the_pole_is_found() {
    let (w, h) = (64, 32);
    for row in [0, h - 1] {
        let mut map = Environment { width: w, height: h, radiance: vec![[0.0; 3]; w * h] };
        map.radiance[row * w + 11] = [3.0, 1.0, 2.0];
        let sky = Sky::new(&map);
        // ∫ luminance dω two ways: over a fine grid, and by draws
        let (fh, fw) = (2048, 4096);
        let omega = solid_angles(fw, fh).0;
        let rows = if row == 0 { 0..fh / 8 } else { fh - fh / 8..fh };
        let mut integral = 0.0;
        for i in rows {
            for j in 0..fw {
                let l = sky.radiance(texel_center(fw, fh, i, j));
                integral += omega[i] * f64::from(dot(l, LUMINANCE));
            }
        }
        let n = 100_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for i in 0..n {
            let d = sky.draw(word(i), [uniform(i, 32), uniform(i, 33)]).expect("not black");
            assert!(d.density > 0.0 && d.density.is_finite(), "density {}", d.density);
            let x = f64::from(dot(sky.radiance(d.towards), LUMINANCE) / d.density);
            sum += x;
            square += x * x;
        }
        let mean = sum / f64::from(n as u32);
        let error = ((square / f64::from(n as u32) - mean * mean) / f64::from(n as u32)).sqrt();
        println!("row {row}: grid {integral:.6}, draws {mean:.6} ± {error:.6}");
        assert!(
            (mean - integral).abs() <= 3.0 * error + 1e-4 * integral,
            "{mean} ± {error}, grid {integral}"
        );
    }
}

#[test]
fn a_constant_map_gives_irradiance_pi() {
    // The difference between the reflection of a white and of a black surface is E/π, by the operator that
    // integrates complete maps; rows are fine enough for its midpoint rule, which is off by the factor
    // 1/cos(π/2H).
    let (w, h) = (2048, 2048);
    let light = [2.5_f32, 0.5, 1.0];
    let env = vec![light; w * h];
    let four = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0], on_sphere(3, 9)];
    let normals = [four, four].concat();
    let albedo = [[[1.0; 3]; 4], [[0.0; 3]; 4]].concat();
    let x = envmap::In {
        normal: &normals,
        view: &normals,
        albedo: &albedo,
        roughness: &[1.0; 8],
        metallic: &[0.0; 8],
        env: &env,
        height: h,
        width: w,
    };
    let mut radiance = [[0.0; 3]; 8];
    envmap::forward(x, &mut radiance);
    for (p, n) in four.iter().enumerate() {
        for k in 0..3 {
            let e = PI * (f64::from(radiance[p][k]) - f64::from(radiance[p + 4][k]));
            let off = e / (PI * f64::from(light[k])) - 1.0;
            println!("normal {n:?}, channel {k}: irradiance/πL − 1 = {off:.1e}");
            assert!(off.abs() <= 1e-6, "normal {n:?}, channel {k}: irradiance {e} of radiance {}", light[k]);
        }
    }
    let map = Environment::constant([2.5, 0.5, 1.0]);
    let sky = Sky::new(&map);
    let map = Environment { width: 8, height: 4, radiance: vec![[2.5, 0.5, 1.0]; 32] };
    let big = Sky::new(&map);
    for i in 0..100 {
        let d = on_sphere(i, 10);
        assert_eq!(sky.radiance(d), [2.5, 0.5, 1.0], "constant everywhere");
        assert_eq!((big.radiance(d), big.density(d)), (sky.radiance(d), sky.density(d)), "whatever its size");
    }
}

#[test]
fn all_texel_centres_are_those_of_each() {
    for (w, h) in [(1, 1), (6, 4), (33, 17)] {
        let all = texel_centers(w, h);
        assert_eq!(all.len(), w * h, "{w}×{h}");
        for (t, d) in all.iter().enumerate() {
            let one = texel_center(w, h, t / w, t % w);
            assert_eq!(d.map(f32::to_bits), one.map(f32::to_bits), "{w}×{h}, texel {t}");
        }
    }
}

#[test]
fn a_black_map_is_no_light() {
    let map = Environment { width: 8, height: 4, radiance: vec![[0.0; 3]; 32] };
    let sky = Sky::new(&map);
    assert!(sky.is_black(), "it says so");
    assert!(sky.draw(7, [0.5, 0.5]).is_none(), "nothing is drawn");
    assert!(sky.probabilities().is_empty(), "no table");
    assert_eq!((sky.density([0.0, 0.6, 0.8]), sky.radiance([0.0, 0.6, 0.8])), (0.0, [0.0; 3]), "no light");
}

#[test]
fn look_ups_are_continuous_at_the_seam_and_at_the_poles() {
    let map = uneven(16, 8);
    let sky = Sky::new(&map);
    let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|k| (a[k] - b[k]).abs() <= 2e-3 * (1.0 + a[k].abs()));
    for k in 1..40 {
        let z = (k as f32 / 20.0 - 1.0) * 0.999;
        let s = (1.0 - z * z).sqrt();
        let (l, r) = (sky.radiance([1e-6, -s, z]), sky.radiance([-1e-6, -s, z]));
        assert!(near(l, r), "seam at z = {z}: {l:?}, {r:?}");
    }
    for pole in [1.0_f32, -1.0] {
        let there = sky.radiance([0.0, 0.0, pole]);
        for k in 0..16 {
            let a = std::f64::consts::TAU * f64::from(k) / 16.0;
            let d = [1e-4 * libm::sin(a) as f32, 1e-4 * libm::cos(a) as f32, pole];
            assert!(near(there, sky.radiance(d)), "pole {pole}, azimuth {a}");
        }
    }
    // and at texel centres they give the texels
    let map = uneven(16, 8);
    for t in 0..16 * 8 {
        let got = sky.radiance(texel_center(16, 8, t / 16, t % 16));
        for k in 0..3 {
            let want = map.radiance[t][k];
            assert!(
                (got[k] - want).abs() <= 1e-4 * (1.0 + want),
                "texel {t}: {got:?}, want {:?}",
                map.radiance[t]
            );
        }
    }
}

#[test]
fn eight_have_the_bits_of_one() {
    let map = uneven(33, 17);
    let sky = Sky::new(&map);
    for i in (0..800).step_by(8) {
        let towards: [f32x8; 3] =
            std::array::from_fn(|k| f32x8::new(std::array::from_fn(|l| on_sphere(i + l, 11)[k])));
        let (radiance, density) = sky.look8(towards, 0xff);
        let words = std::array::from_fn(|l| word(i + l));
        let u: [[f32; 8]; 2] =
            std::array::from_fn(|k| std::array::from_fn(|l| uniform(i + l, 34 + k as u16)));
        let (drawn, drawn_density) = sky.draw8(&words, [&u[0], &u[1]]).expect("not black");
        for l in 0..8 {
            let d = on_sphere(i + l, 11);
            let one = sky.draw(words[l], [u[0][l], u[1][l]]).expect("not black");
            assert_eq!(density.to_array()[l], sky.density(d), "density of {d:?}");
            assert_eq!(drawn_density.to_array()[l], one.density, "density of draw {}", i + l);
            for k in 0..3 {
                assert_eq!(radiance[k].to_array()[l], sky.radiance(d)[k], "radiance of {d:?}");
                assert_eq!(drawn[k].to_array()[l], one.towards[k], "draw {}", i + l);
            }
        }
    }
}

/// A large map has a table of cells. Here the table is small instead: sizes that divide the map, and others.
#[test]
fn a_table_of_cells_integrates_to_one_and_finds_all_light() {
    for (w, h, most) in [(16, 8, 32), (33, 17, 50), (64, 32, 1)] {
        let map = uneven(w, h);
        let (sky, full) = (Sky::with_cells(&map, most), Sky::new(&map));
        let [columns, rows] = sky.cells();
        assert!(columns * rows <= most && full.cells() == [w, h], "{columns}×{rows} cells for {w}×{h}");
        let (p, omega) = (sky.probabilities(), solid_angles(columns, rows).0);
        assert!(
            (p.iter().fold(0.0, |a, b| a + b) - 1.0).abs() <= 1e-12,
            "{w}×{h}: the probabilities sum to 1"
        );
        for t in 0..columns * rows {
            let density = f64::from(sky.density(texel_center(columns, rows, t / columns, t % columns)));
            let gap = (density * omega[t / columns] - p[t]).abs();
            assert!(gap <= 1e-7 * p[t] + 1e-14, "{w}×{h}, cell {t}: density {density}, probability {}", p[t]);
        }
        // The light of the whole sphere, by draws from either table.
        let n = 200_000;
        let light = |sky: &Sky<'_>| {
            let (mut sum, mut square) = (0.0, 0.0);
            for i in 0..n {
                let d = sky.draw(word(i), [uniform(i, 34), uniform(i, 35)]).expect("not black");
                let x = f64::from(dot(full.radiance(d.towards), LUMINANCE) / d.density);
                (sum, square) = (sum + x, square + x * x);
            }
            let mean = sum / n as f64;
            (mean, (square / n as f64 - mean * mean) / n as f64)
        };
        let ((a, va), (b, vb)) = (light(&sky), light(&full));
        println!("{w}×{h} in {columns}×{rows} cells: {a:.4}, in texels {b:.4}");
        assert!((a - b).abs() <= 4.0 * (va + vb).sqrt(), "{w}×{h}: {a} by cells, {b} by texels");
    }
}
