//! Materials and their images.

use super::container::{EXTENSIONS, resolve};
use super::read::{Reader, named};
use super::{Alpha, Image, MAX_TEXELS, Material, TextureRef, UvTransform, Wrap};
use crate::io::{MAX_SMALL_FILE_BYTES, image_file};
use crate::num::order;
use crate::{Error, Result};
use std::sync::Arc;

impl Reader<'_> {
    pub(super) fn materials(&mut self) -> Result<()> {
        self.out.images = vec![None; self.document.images().len()];
        let mut used = vec![false; self.document.materials().len()];
        for p in self.out.meshes.iter().flat_map(|m| &m.primitives) {
            if let Some(m) = p.material {
                used[m] = true;
            }
        }
        for m in self.document.materials() {
            let index = m.index().unwrap_or(0);
            let pbr = m.pbr_metallic_roughness();
            let info = |i: &gltf::texture::Info<'_>| {
                let t = i.texture_transform();
                let transform = t.as_ref().map_or(UvTransform::IDENTITY, |t| UvTransform {
                    offset: t.offset(),
                    rotation: t.rotation(),
                    scale: t.scale(),
                });
                let set = t.and_then(|t| t.tex_coord()).unwrap_or_else(|| i.tex_coord());
                texture_ref(&i.texture(), set, transform)
            };
            let strength = m.emissive_strength().unwrap_or(1.0);
            let material = Material {
                name: named(m.name(), "material", index),
                base_color: pbr.base_color_factor(),
                base_color_texture: pbr.base_color_texture().as_ref().map(info),
                metallic: pbr.metallic_factor(),
                roughness: pbr.roughness_factor(),
                metallic_roughness_texture: pbr.metallic_roughness_texture().as_ref().map(info),
                // The crate has no transform for normal maps; a file that moves them moves the others alike.
                normal_texture: m.normal_texture().map(|n| {
                    let transform = pbr
                        .base_color_texture()
                        .as_ref()
                        .map_or(UvTransform::IDENTITY, |i| info(i).transform);
                    (texture_ref(&n.texture(), n.tex_coord(), transform), n.scale())
                }),
                emission: m.emissive_factor().map(|x| x * strength),
                emission_texture: m.emissive_texture().as_ref().map(info),
                alpha: match m.alpha_mode() {
                    gltf::material::AlphaMode::Opaque => Alpha::Opaque,
                    gltf::material::AlphaMode::Mask => Alpha::Mask(m.alpha_cutoff().unwrap_or(0.5)),
                    gltf::material::AlphaMode::Blend => Alpha::Blend,
                },
                double_sided: m.double_sided(),
            };
            if used[index] {
                if m.occlusion_texture().is_some() {
                    self.note("occlusion textures are not read: shadows are computed".into());
                }
                let borrowed =
                    material.normal_texture.is_some_and(|(t, _)| t.transform != UvTransform::IDENTITY);
                if borrowed {
                    self.note(
                        "the texture transform of a normal map is taken to be that of the base colour".into(),
                    );
                }
                let maps = [
                    &material.base_color_texture,
                    &material.metallic_roughness_texture,
                    &material.emission_texture,
                ];
                let maps = maps.into_iter().flatten().copied().chain(material.normal_texture.map(|(t, _)| t));
                for t in maps {
                    self.image(t.image)?;
                }
            }
            self.out.materials.push(material);
        }
        for e in &self.document.as_json().extensions_used {
            if e.starts_with("KHR_materials_") && !EXTENSIONS.contains(&e.as_str()) {
                self.note(format!("{} is not read", e.chars().take(60).collect::<String>()));
            }
        }
        Ok(())
    }

    /// Decodes an image once.
    fn image(&mut self, index: usize) -> Result<()> {
        if self.out.images[index].is_some() {
            return Ok(());
        }
        let place = format!("images[{index}]");
        let (document, name) = (self.document, self.name);
        let image = document.images().nth(index);
        let image = image.ok_or_else(|| self.error(place.clone()).expected("an image").got("nothing"))?;
        let owned;
        let bytes: &[u8] = match image.source() {
            gltf::image::Source::View { view, .. } => self.buffers.view(&view)?,
            gltf::image::Source::Uri { uri, .. } => {
                owned = resolve(uri, name, &place, self.fetch)?;
                if owned.len() as u64 > MAX_SMALL_FILE_BYTES {
                    let e = self.error(place);
                    return Err(e
                        .expected(format!("at most {MAX_SMALL_FILE_BYTES} bytes"))
                        .got(owned.len().to_string()));
                }
                &owned
            }
        };
        let left = MAX_TEXELS - self.texels;
        let decoded = rgba(bytes, left).map_err(|e| e.within(name).at(place))?;
        self.texels += decoded.1.len() as u64;
        let ([width, height], texels) = decoded;
        self.out.images[index] =
            Some(Arc::new(Image { name: named(image.name(), "image", index), width, height, texels }));
        Ok(())
    }
}

fn texture_ref(t: &gltf::Texture<'_>, set: u32, transform: UvTransform) -> TextureRef {
    use gltf::texture::WrappingMode as W;
    let wrap = |w| match w {
        W::ClampToEdge => Wrap::Clamp,
        W::MirroredRepeat => Wrap::Mirror,
        W::Repeat => Wrap::Repeat,
    };
    let sampler = t.sampler();
    let wrap = [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())];
    TextureRef { image: t.source().index(), wrap, uv_set: set as usize, transform }
}

/// Size and RGBA texels of an image of at most `most` pixels; 16-bit values are rounded to 8.
pub(in crate::io) fn rgba(bytes: &[u8], most: u64) -> Result<([usize; 2], Vec<[u8; 4]>)> {
    let [w, h] = image_file::size(bytes, "image")?;
    if w as u64 * h as u64 > most {
        let e = Error::input("image").at("size");
        return Err(e.expected(format!("at most {most} more texels in this file")).got(format!("{w}x{h}")));
    }
    // An image of one colour packs a thousand pixels into a byte, and so does a bomb: such a one has at most
    // 4096² pixels.
    let plain = (bytes.len() as u64).saturating_mul(64);
    if w as u64 * h as u64 > order::max(plain, 1 << 24) {
        let e = Error::input("image").at("size");
        return Err(e
            .expected("at most 4096x4096 pixels, or 64 per byte")
            .got(format!("{w}x{h} in {} bytes", bytes.len())));
    }
    let p = image_file::parse(bytes, "image")?;
    let byte = |i: usize| match &p.samples {
        image_file::Samples::U8(v) => Ok(v[i]),
        image_file::Samples::U16(v) => Ok(((u32::from(v[i]) * 255 + 32_767) / 65_535) as u8),
        image_file::Samples::F32(_) => Err(Error::input("image")
            .expected("an image of 8 or 16 bits, such as PNG or JPEG")
            .got("an image of floats")),
    };
    let n = p.channels.len();
    let mut texels = Vec::with_capacity(p.width * p.height);
    for i in 0..p.width * p.height {
        let at = |c: usize| byte(i * n + c);
        texels.push(match n {
            1 => [at(0)?, at(0)?, at(0)?, 255],
            2 => [at(0)?, at(0)?, at(0)?, at(1)?],
            3 => [at(0)?, at(1)?, at(2)?, 255],
            _ => [at(0)?, at(1)?, at(2)?, at(3)?],
        });
    }
    Ok(([p.width, p.height], texels))
}
