//! The OpenEXR part of [`super::image_file`].

use super::image_data::{Encoding, Orientation, Picture, Samples, check_size};
use super::read::reported;
use super::{guard, memory};
use crate::{Error, Result};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding as ExrEncoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, MetaData, ReadChannels, ReadLayers, Vec2, WritableImage, read,
};
use std::io::Cursor;

/// Most channels of a layer that are read.
const MAX_CHANNELS: usize = 64;

/// The first layer of a file: channels in the order R G B (A) if these are all its channels, else sorted by
/// name.
pub(super) fn parse(bytes: &[u8], name: &str) -> Result<Picture> {
    let broken = |at: &str, e: exr::error::Error| {
        Error::input(name).at(at).expected("a complete OpenEXR image").got(reported(&e))
    };
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| broken("header", e))?;
    let header = meta
        .headers
        .first()
        .ok_or_else(|| Error::input(name).at("header").expected("at least one layer").got("none"))?;
    let count = header.channels.list.len();
    if count == 0 || count > MAX_CHANNELS {
        let expected = format!("1 to {MAX_CHANNELS} channels");
        return Err(Error::input(name).at("header").expected(expected).got(count.to_string()));
    }
    // Every layer is decoded to find the first, and ZIP shrinks a two-byte sample by at most 1032.
    for h in &meta.headers {
        let channels = crate::num::order::max(h.channels.list.len(), 1) as u64;
        check_size(
            h.layer_size.x() as u64,
            h.layer_size.y() as u64,
            bytes.len(),
            520_u64.div_ceil(channels),
            name,
        )?;
        if let Some(c) = h.channels.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            return Err(Error::input(name)
                .at(format!("channel {}", c.name))
                .expected("one sample per pixel")
                .got("fewer"));
        }
    }
    // All layers as they are decoded, and the samples of the first in f32.
    let decoded = meta.headers.iter().fold(0, |n, h| {
        n + h.layer_size.x() as u64 * h.layer_size.y() as u64 * h.channels.list.len() as u64 * 4
    });
    memory::check(name, decoded.saturating_mul(2))?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| broken("image data", e))?;
    let layer = image.layer_data;
    let (width, height) = (layer.size.x(), layer.size.y());
    let mut list: Vec<(String, FlatSamples)> =
        layer.channel_data.list.into_iter().map(|c| (c.name.to_string(), c.sample_data)).collect();
    let rank = |n: &str| ["R", "G", "B", "A"].iter().position(|x| *x == n);
    if list.iter().all(|(n, _)| rank(n).is_some()) {
        list.sort_by_key(|(n, _)| rank(n));
    } else {
        list.sort_by(|a, b| a.0.cmp(&b.0));
    }
    let count = list.len();
    let mut samples = memory::filled(name, width * height * count, 0.0f32)?;
    for (c, (channel, data)) in list.iter().enumerate() {
        if data.len() != width * height {
            let e = Error::input(name).at(format!("channel {channel}"));
            return Err(e.expected(format!("{} samples", width * height)).got(data.len().to_string()));
        }
        for (i, x) in data.values_as_f32().enumerate() {
            if !x.is_finite() {
                return Err(Error::input(name)
                    .at(format!("channel {channel}, row {}, column {}", i / width, i % width))
                    .expected("a finite number")
                    .got(x.to_string()));
            }
            samples[i * count + c] = x;
        }
    }
    let channels = list.into_iter().map(|(n, _)| n).collect();
    Ok(Picture {
        width,
        height,
        channels,
        encoding: Encoding::Linear,
        samples: Samples::F32(samples),
        orientation: Orientation::STORED,
    })
}

pub(super) fn to_bytes(width: usize, height: usize, channels: &[&str], data: &[f32]) -> Result<Vec<u8>> {
    let what = "EXR";
    check_size(width as u64, height as u64, usize::MAX >> 1, 1, what)?;
    let n = channels.len();
    if n == 0 || n > MAX_CHANNELS || data.len() != width * height * n {
        let got = format!("{} values for {height}x{width}x{n}", data.len());
        return Err(Error::input(what)
            .expected(format!("1 to {MAX_CHANNELS} channels and H·W·C values"))
            .got(got));
    }
    if let Some(i) = data.iter().position(|x| !x.is_finite()) {
        let (pixel, c) = (i / n, i % n);
        return Err(Error::input(what)
            .at(format!("channel {}, row {}, column {}", channels[c], pixel / width, pixel % width))
            .expected("a finite number")
            .got(data[i].to_string()));
    }
    guard(what, || {
        let list = channels
            .iter()
            .enumerate()
            .map(|(c, &name)| {
                let plane = data[c..].iter().step_by(n).copied().collect();
                AnyChannel::new(name, FlatSamples::F32(plane))
            })
            .collect();
        let encoding = ExrEncoding {
            compression: Compression::ZIP16,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        let layer =
            Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(list));
        let mut out = Cursor::new(Vec::new());
        Image::from_layer(layer)
            .write()
            .non_parallel()
            .to_buffered(&mut out)
            .map_err(|e| Error::input(what).got(e.to_string()))?;
        Ok(out.into_inner())
    })
}
