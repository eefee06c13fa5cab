use super::*;
use crate::num::array::Arrays;
use crate::num::rng::Rng;

/// Numbers drawn from a number of an array.
fn draws(n: usize, array: u32) -> Vec<f32> {
    (0..n).map(|i| Rng::new(3).normal_f32(i as u64, array, 0x7f1d, 0)).collect()
}

fn network(widths: &[usize], number: u32) -> Network {
    let weights = widths.windows(2).zip(number..).map(|(n, i)| draws(n[0] * n[1], i)).collect();
    Network { widths: widths.to_vec(), weights }
}

/// A field with every part.
fn complete() -> Field {
    Field {
        planes: Planes { values: draws(6 * 16 * 2, 0), count: 6, side: 4, channels: 2 },
        panoramas: Some(Panoramas {
            values: draws(2 * 3 * 4 * 2, 1),
            levels: 2,
            height: 3,
            width: 4,
            channels: 2,
        }),
        heads: Heads {
            sdf: network(&[6, 4, 4, 1], 10),
            color: Some(network(&[8, 4, 3], 20)),
            albedo: Some(network(&[6, 4, 3], 30)),
            material: Some(network(&[6, 2], 40)),
            normal: Some(network(&[6, 4, 3], 50)),
            rho: Some(network(&[6, 4, 1], 60)),
        },
        settings: Settings { inverse_beta: 133.7, early_stop: Some(1e-4), ..Settings::default() },
        placement: Placement::new([0.1, -2.0 / 3.0, 1e-17], 1.0 / 3.0),
    }
}

/// A trunk on three planes that are added.
fn trunk() -> Field {
    Field {
        planes: Planes { values: draws(3 * 9 * 5, 0), count: 3, side: 3, channels: 5 },
        panoramas: None,
        heads: Heads { sdf: network(&[5, 8, 4], 10), ..Heads::default() },
        settings: Settings { combine: Combine::Sum, early_stop: None, ..Settings::default() },
        placement: Placement::default(),
    }
}

#[test]
fn what_is_written_is_read_back_in_bits() {
    for field in [complete(), trunk()] {
        let bytes = field.to_bytes().expect("a valid field");
        let read = Field::parse(&bytes, "a.safetensors").expect("our own file");
        assert_eq!(read, field, "all values");
        assert_eq!(read.digest().expect("finite"), field.digest().expect("finite"), "all bits");
        assert_eq!(read.to_bytes().expect("valid"), bytes, "the same bytes");
        let bits = |f: &Field| f.placement.center.map(f64::to_bits);
        assert_eq!(bits(&read), bits(&field), "the centre");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let e = Field::read(folder.path()).expect_err("no file").to_string();
    assert!(e.contains("a folder without field.safetensors"), "{e}");
    trunk().write(&folder.path().join(FILE)).expect("writable");
    assert_eq!(Field::read(folder.path()).expect("the file in the folder"), trunk(), "by its folder");
}

#[test]
fn files_from_before_the_least_weight_are_read() {
    let mut field = trunk();
    field.settings.least_weight = None;
    // of a file that an earlier version wrote
    assert_eq!(field.digest().expect("finite"), "100ee4fd32d372a6");
    let bytes = field.to_bytes().expect("valid");
    assert!(!bytes.windows(12).any(|w| w == b"least_weight"), "no such entry");
    assert_eq!(Field::parse(&bytes, "a").expect("our own file"), field);
}

#[test]
fn a_colour_may_read_the_cosine_of_the_reflection() {
    let mut field = complete();
    field.heads.color = Some(network(&[9, 4, 3], 20));
    assert_eq!(Field::parse(&field.to_bytes().expect("valid"), "a").expect("our own file"), field);
    (field.panoramas, field.heads.rho) = (None, None);
    field.heads.color = Some(network(&[7, 4, 3], 20));
    let e = field.validate().expect_err("nothing is reflected without panoramas").to_string();
    assert!(e.starts_with("head 'color': expected 6 inputs, got 7"), "{e}");
}

#[test]
fn zeros_of_both_signs_are_kept() {
    let mut field = trunk();
    (field.planes.values[0], field.planes.values[1]) = (0.0, -0.0);
    let read = Field::parse(&field.to_bytes().expect("valid"), "a").expect("our own file");
    assert_eq!([0, 1].map(|i| read.planes.values[i].to_bits()), [0.0_f32, -0.0].map(f32::to_bits), "signs");
}

#[test]
fn every_setting_decides_the_digest() {
    let of = |settings: Settings| Field { settings, ..trunk() }.digest().expect("finite");
    let base = trunk().settings;
    let others = [
        Settings { half_size: 1.0, ..base.clone() },
        Settings { samples: 64, ..base.clone() },
        Settings { rule: Rule::Left, ..base.clone() },
        Settings { inverse_beta: 199.0, ..base.clone() },
        Settings { early_stop: Some(0.0), ..base.clone() },
        Settings { least_weight: Some(0.5), ..base.clone() },
        Settings { least_weight: None, ..base.clone() },
        Settings { stencil: Stencil::Central, ..base.clone() },
        Settings { epsilon: 0.5, ..base.clone() },
        Settings { background: 0.0, ..base.clone() },
    ];
    let mut all: Vec<String> = others.into_iter().map(of).collect();
    all.push(of(base));
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), 11, "eleven digests");
}

/// A change that makes a field invalid, and what the message names.
type Fault = (fn(&mut Field), &'static str);

#[test]
fn invalid_fields_are_refused_with_the_place() {
    let cases: &[Fault] = &[
        (|f| f.planes.values[7] = f32::NAN, "planes: index [0, 0, 3, 1]: expected a finite number"),
        (|f| f.planes.values[0] = f32::INFINITY, "planes: index [0, 0, 0, 0]"),
        (|f| f.planes.count = 4, "planes: expected three or six planes, got 4"),
        (|f| f.planes.side = 5, "planes: expected values of the shape [6, 5, 5, 2]"),
        (|f| f.planes.side = 1, "planes: side: expected 2 to 4096, got 1"),
        (|f| f.settings.combine = Combine::Sum, "head 'sdf': expected 2 inputs, got 6"),
        (|f| f.heads.color = None, "panoramas: expected heads 'color', 'normal' and 'rho'"),
        (|f| f.panoramas = None, "head 'rho': expected panoramas"),
        (|f| f.heads.sdf = network(&[6, 4, 4], 10), "head 'sdf': expected 1 output beside a head 'color'"),
        (|f| f.heads.sdf = network(&[6, 2], 10), "head 'sdf': expected 1 or 4 outputs, got 2"),
        (|f| f.heads.albedo = Some(network(&[6, 2], 0)), "head 'albedo': expected 3 outputs, got 2"),
        (|f| f.heads.sdf.weights[1][2] = f32::NAN, "head 'sdf', layer 1: index [0, 2]"),
        (|f| f.heads.sdf.weights[0].truncate(3), "head 'sdf', layer 0: expected values of the shape [4, 6]"),
        (|f| f.settings.samples = 0, "setting 'samples'"),
        (|f| f.settings.inverse_beta = f32::NAN, "setting 'inverse_beta': expected"),
        (|f| f.settings.epsilon = 0.0, "setting 'epsilon'"),
        (|f| f.settings.least_weight = Some(2.0), "setting 'least_weight': expected 0 to 1, got 2"),
        (|f| f.heads.color = Some(network(&[10, 4, 3], 20)), "head 'color': expected 8 inputs, got 10"),
        (|f| f.settings.background = 2.0, "setting 'background': expected 0 to 1, got 2"),
        (|f| f.placement.scale = 0.0, "placement: scale"),
        (|f| f.placement.center[1] = f64::NAN, "placement: centre"),
    ];
    for (spoil, expected) in cases {
        let mut field = complete();
        spoil(&mut field);
        let e = field.validate().expect_err("not valid").to_string();
        assert!(e.starts_with(expected), "expected '{expected}…', got '{e}'");
        assert!(field.to_bytes().is_err(), "not written: {e}");
    }
}

#[test]
fn files_of_other_contents_are_refused_with_the_place() {
    let (arrays, metadata) = {
        let file = crate::io::safetensors::parse(&trunk().to_bytes().expect("valid"), "a").expect("read");
        (file.arrays, file.metadata)
    };
    let read = |arrays: &Arrays, metadata: &std::collections::BTreeMap<String, String>| {
        let bytes = crate::io::safetensors::to_bytes(arrays, metadata);
        Field::parse(&bytes, "a.safetensors").map(drop).expect_err("refused").to_string()
    };
    let with_array = |name: &str, array: Option<crate::num::array::Array>| {
        let mut arrays = arrays.clone();
        match array {
            Some(array) => drop(arrays.0.insert(name.to_owned(), array)),
            None => drop(arrays.0.remove(name)),
        }
        read(&arrays, &metadata)
    };
    let new = |shape: &[usize]| {
        crate::num::array::Array::new(shape, vec![0.5_f32; crate::num::array::entries(shape)])
    };
    let with_meta = |key: &str, from: &str, to: &str| {
        let mut metadata = metadata.clone();
        let entry = metadata.get_mut(key).expect("an entry");
        assert!(entry.contains(from), "{key} contains {from}: {entry}");
        *entry = entry.replace(from, to);
        read(&arrays, &metadata)
    };
    for (message, expected) in [
        (with_array("planes", None), "array 'planes': expected to be present"),
        (with_array("planes", Some(new(&[3, 3, 3, 4]))), "head 'sdf': expected 4 inputs, got 5"),
        (with_array("planes", Some(new(&[3, 3, 4, 5]))), "array 'planes': expected square planes"),
        (
            with_array("planes", Some(new(&[3, 3, 5]))),
            "array 'planes': expected numbers of type float32 with 4 axes",
        ),
        (with_array("planes", Some(new(&[3, 3, 3, 5]))), "metadata: digest: expected"),
        (with_array("heads/sdf/0", None), "array 'heads/sdf/0': expected to be present"),
        (with_array("heads/sdf/1", Some(new(&[4, 7]))), "array 'heads/sdf/1': expected 8 inputs"),
        (with_array("heads/glow/0", Some(new(&[4, 5]))), "array 'heads/glow/0': expected no such array"),
        (
            with_array("placement/scale", Some(new(&[1]))),
            "array 'placement/scale': expected 1 numbers of type float64",
        ),
        (with_meta("kind", "field", "splat"), "metadata: kind: expected field, got splat"),
        (with_meta("heads", "trunk", "separate"), "metadata: heads: expected trunk, got separate"),
        (
            with_meta("settings", "\"samples\":128", "\"samples\":-1"),
            "setting 'samples': expected a positive",
        ),
        (
            with_meta("settings", "\"sum\"", "\"max\""),
            "setting 'combine': expected one of concat, sum, got max",
        ),
        (with_meta("settings", "\"rule\"", "\"ruler\""), "metadata 'settings': expected an entry 'rule'"),
        (with_meta("settings", "{", "{\"glow\":1,"), "metadata 'settings': entry 'glow'"),
        (with_meta("settings", "{", "["), "metadata 'settings': line 1"),
        (with_meta("settings", "\"background\":1.0", "\"background\":0.5"), "metadata: digest"),
    ] {
        assert!(
            message.starts_with(&format!("a.safetensors: {expected}")),
            "expected '{expected}', got '{message}'"
        );
    }
}
