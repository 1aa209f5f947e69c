//! The colour image around the meniscus as a bitmap inside the page.

use arthro_proto::registration::v1::Intrinsics;

use crate::scene::Scene;

/// Pixels left around the meniscus.
const MARGIN_PX: usize = 30;

/// The picture with its caption.
pub fn figure(scene: &Scene) -> String {
    let intrinsics = scene.header.intrinsics.unwrap_or_default();
    let Some(crop) = Crop::around_mask(scene, &intrinsics) else {
        return "<p>The meniscus was not in view.</p>".to_owned();
    };
    format!(
        "<figure><img width=\"{}\" alt=\"colour frame\" src=\"data:image/bmp;base64,{}\">\
         <figcaption>Colour frame of the simulated RGB-D camera, cut to the meniscus.</figcaption></figure>",
        crop.width * 2,
        base64(&bitmap(scene, &intrinsics, &crop))
    )
}

struct Crop {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Crop {
    fn around_mask(scene: &Scene, intrinsics: &Intrinsics) -> Option<Self> {
        let (width, height) = (intrinsics.width_px as usize, intrinsics.height_px as usize);
        let seen = || {
            let pixels = scene.mask.iter().enumerate();
            pixels
                .filter(|(_, mask)| **mask != 0)
                .map(|(index, _)| (index % width, index / width))
        };
        let left = seen().map(|(x, _)| x).min()?.saturating_sub(MARGIN_PX);
        let top = seen().map(|(_, y)| y).min()?.saturating_sub(MARGIN_PX);
        let right = (seen().map(|(x, _)| x).max()? + MARGIN_PX).min(width - 1);
        let bottom = (seen().map(|(_, y)| y).max()? + MARGIN_PX).min(height - 1);
        Some(Self {
            left,
            top,
            width: right - left + 1,
            height: bottom - top + 1,
        })
    }
}

/// A 24-bit BMP: 54 bytes of header, rows bottom up in blue, green, red, padded to four bytes.
fn bitmap(scene: &Scene, intrinsics: &Intrinsics, crop: &Crop) -> Vec<u8> {
    let stride = (crop.width * 3).next_multiple_of(4);
    let size = 54 + stride * crop.height;
    let mut file = Vec::with_capacity(size);
    file.extend_from_slice(b"BM");
    for field in [
        size as u32,
        0,
        54,
        40,
        crop.width as u32,
        crop.height as u32,
    ] {
        file.extend_from_slice(&field.to_le_bytes());
    }
    file.extend_from_slice(&1_u16.to_le_bytes());
    file.extend_from_slice(&24_u16.to_le_bytes());
    file.resize(54, 0);
    for row in (0..crop.height).rev() {
        let first = (crop.top + row) * intrinsics.width_px as usize + crop.left;
        for pixel in first..first + crop.width {
            let color = &scene.color[3 * pixel..3 * pixel + 3];
            file.extend(color.iter().rev());
        }
        file.resize(file.len() + stride - crop.width * 3, 0);
    }
    file
}

/// RFC 4648 with padding.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let bits = group
            .iter()
            .fold(0_u32, |bits, byte| (bits << 8) | u32::from(*byte))
            << (8 * (3 - group.len()));
        for place in 0..4 {
            if place <= group.len() {
                let index = (bits >> (18 - 6 * place)) & 63;
                text.push(char::from(ALPHABET[index as usize]));
            } else {
                text.push('=');
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::base64;

    #[test]
    fn base64_agrees_with_the_examples_of_rfc_4648() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }
}
