//! The settings of a run as tables: what differs from the defaults first, the rest by group, numbers as they are typed.

use super::{code, table, text};
use maud::{Markup, html};
use serde_json::Value;

/// Groups and the beginnings of the names of their settings; the first group that fits has the setting.
const GROUPS: [(&str, &[&str]); 10] = [
    (
        "Input",
        &[
            "input",
            "train_",
            "model",
            "extent",
            "scene",
            "capture",
            "views",
            "downscale",
            "crop",
            "images_per_set",
            "state",
            "box",
            "field_axes",
        ],
    ),
    ("Length and seed", &["iterations", "seed", "steps", "warm_up", "round"]),
    ("Rendering", &["profile", "alpha_max", "antialiased", "background", "random_background", "sh_degree"]),
    ("Learning rates", &["rate_", "lr"]),
    ("Losses and priors", &["ssim_weight", "alpha_weight", "latent_weight", "prior_", "w_"]),
    ("Density control", &["density", "strategy", "max_gaussians", "tau_", "latent_every"]),
    ("Progressive update", &["progressive", "lambda", "order", "key", "graph_given"]),
    (
        "Factors and graph",
        &["factor", "mechanism", "reading", "supervision", "independence_on", "tau", "alpha"],
    ),
    ("Batches", &["batch_"]),
    (
        "Gaussians and networks",
        &["first_light", "first_opacity", "first_scale", "weights_network", "pose_network"],
    ),
];
/// The group of all other settings.
const OTHER: &str = "Other";

/// A value as text. A number that is exactly a 32-bit one has the fewest digits that give it back: `0.6`, not `0.6000000238418579`.
fn typed(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        Value::Number(n) if n.is_f64() => {
            let wide = n.as_f64().unwrap_or(f64::NAN);
            let narrow = wide as f32;
            if f64::from(narrow) == wide { format!("{narrow:?}") } else { format!("{wide:?}") }
        }
        Value::Array(all) => format!("[{}]", all.iter().map(typed).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

fn group(name: &str) -> &'static str {
    let fits = |starts: &&[&str]| starts.iter().any(|s| name.starts_with(s));
    GROUPS.iter().find(|(_, starts)| fits(starts)).map_or(OTHER, |(group, _)| group)
}

/// The tables. `defaults` are the settings of the same command without options, as far as they do not depend on the input.
pub(super) fn tables(settings: &Value, defaults: Option<&Value>) -> Markup {
    let all: Vec<(&str, &Value)> =
        settings.as_object().into_iter().flatten().map(|(k, v)| (k.as_str(), v)).collect();
    let usual = |name: &str| defaults.and_then(|d| d.get(name));
    let changed: Vec<Vec<Markup>> = (all.iter())
        .filter_map(|(name, value)| {
            let usual = usual(name)?;
            (usual != *value).then(|| vec![text(name), code(typed(value)), code(typed(usual))])
        })
        .collect();
    let groups = GROUPS.iter().map(|(group, _)| *group).chain([OTHER]);
    let by_group: Vec<(&str, Vec<Vec<Markup>>)> = groups
        .map(|name| {
            let own = all.iter().filter(|(k, _)| group(k) == name);
            (name, own.map(|(k, v)| vec![text(k), code(typed(v))]).collect::<Vec<_>>())
        })
        .filter(|(_, rows)| !rows.is_empty())
        .collect();
    html! {
        @if defaults.is_some() {
            h3 { "Different from the defaults" }
            @if changed.is_empty() { p.note { "Nothing: all settings are the defaults." } }
            @else { (table(&["setting", "value", "default"], &changed)) }
            br;
        }
        div.two {
            @for (name, rows) in &by_group { div { h3 { (name) } (table(&["setting", "value"], rows)) } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn numbers_are_as_typed() {
        let cases = [
            (json!(0.6_f32), "0.6"),
            (json!(0.005_f32), "0.005"),
            (json!(0.00016), "0.00016"),
            (json!(0.1), "0.1"),
            (json!(1.0_f32), "1.0"),
            (json!(2e-4_f32), "0.0002"),
            (json!(1500), "1500"),
            (json!(4.620000000000001), "4.620000000000001"),
            (json!([0.3_f32, 1.0_f32]), "[0.3, 1.0]"),
            (json!("inria"), "inria"),
            (json!(null), "null"),
        ];
        for (value, text) in cases {
            assert_eq!(typed(&value), text, "{value}");
            if value.is_number() {
                let back: f64 = typed(&value).parse().expect("a number");
                assert!(
                    value.as_f64() == Some(back) || value.as_f64() == Some(f64::from(back as f32)),
                    "{value}"
                );
            }
        }
    }

    #[test]
    fn differences_come_first() {
        let settings = json!({"iterations": 60, "seed": 0, "prior_reach": 0.6_f32, "input": "ab", "x": 1});
        let page = tables(&settings, Some(&json!({"iterations": 1200, "seed": 0}))).into_string();
        let at = |word: &str| page.find(word).unwrap_or_else(|| panic!("'{word}' in {page}"));
        assert!(
            at("Different from the defaults") < at("1200") && at("1200") < at("Losses and priors"),
            "{page}"
        );
        assert!(at("Losses and priors") < at("Other"), "in groups: {page}");
        assert_eq!(page.matches(">seed</td>").count(), 1, "what is a default is in its group alone");
        let same = tables(&json!({"seed": 0}), Some(&json!({"seed": 0}))).into_string();
        assert!(same.contains("all settings are the defaults"), "{same}");
    }
}
