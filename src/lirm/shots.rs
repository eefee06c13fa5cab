//! The images of an object: cameras, names and split.

use super::settings::{Set, Settings};
use crate::fit::passes::Shot;
use crate::io::capture::Split;
use crate::scene::camera::{Camera, Model};
use crate::scene::from_data_gen;
use data_gen::cameras::{self, CameraView, SET};
use serde_json::{Map, Value, json};

/// The shots of an object, and for a test set the order and choice of its inputs.
pub(super) fn shots(settings: &Settings, k: u64) -> (Vec<Shot>, Option<Value>) {
    let still = |i: usize, p: &CameraView, split: Split| Shot {
        name: format!("{i:04}"),
        camera: from_data_gen::camera(&p.view, Model::Pinhole),
        shutter_close: None,
        split,
        extra: Map::from_iter([
            ("fov_deg".to_owned(), json!(p.fov)),
            ("azimuth_deg".to_owned(), json!(p.azimuth)),
            ("elevation_deg".to_owned(), json!(p.elevation)),
        ]),
    };
    match settings.set {
        Set::Train => {
            let views = cameras::training(settings.seed, k, settings.views, settings.size, settings.framing);
            (views.iter().enumerate().map(|(i, p)| still(i, p, Split::Unknown)).collect(), None)
        }
        Set::Test => {
            let t = cameras::test(settings.seed, k, settings.size);
            let split = |i: usize| {
                if t.inputs.contains(&i) {
                    Split::Train
                } else if t.outputs.contains(&i) {
                    Split::Test
                } else {
                    Split::Val
                }
            };
            let shots = t.views.iter().enumerate().map(|(i, p)| still(i, p, split(i))).collect();
            let names = |list: &[usize]| list.iter().map(|i| format!("{i:04}")).collect::<Vec<_>>();
            let sets = |list: &[usize]| list.chunks(SET).map(names).collect::<Vec<_>>();
            let protocol = json!({
                "input_sets_random": sets(&t.inputs),
                "input_sets_sequential": sets(&t.sequential),
                "outputs": names(&t.outputs),
            });
            (shots, Some(protocol))
        }
        Set::Egocentric => {
            let shot = |(i, m): (usize, &cameras::Moving)| {
                let camera = |v| -> Camera { from_data_gen::camera(v, settings.camera) };
                Shot {
                    name: format!("{i:04}"),
                    camera: camera(&m.open),
                    shutter_close: Some(camera(&m.close)),
                    split: if i % 8 == 7 { Split::Test } else { Split::Train },
                    extra: Map::from_iter([("time_s".to_owned(), json!(m.time))]),
                }
            };
            let all = cameras::head(settings.seed, k, settings.views * settings.every, settings.size);
            let mut frames: Vec<_> = all.into_iter().step_by(settings.every).collect();
            if settings.camera == Model::Pinhole {
                frames = frames.into_iter().map(cameras::Moving::through_pinhole).collect();
            }
            (frames.iter().enumerate().map(shot).collect(), None)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_camera_can_show_one_frame_in_several() {
        let of = |views: usize, every: usize| {
            shots(&Settings { set: Set::Egocentric, views, every, size: 32, ..Settings::default() }, 3).0
        };
        let (all, some) = (of(24, 1), of(3, 8));
        let cameras = |shots: &[Shot]| shots.iter().map(|s| s.camera.clone()).collect::<Vec<_>>();
        assert_eq!(cameras(&some), [0, 8, 16].map(|i| all[i].camera.clone()), "the same motion");
        assert_eq!(some[2].extra["time_s"], json!(1.6));
    }
}
