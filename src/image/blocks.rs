//! Means over square blocks of pixels: what is left of an image when noise is to be judged rather than detail.

use super::Image;
use crate::color::Rgb;

/// Side in pixels of the blocks over which noise is judged.
pub const BLOCK_SIZE: u32 = 16;

/// The image of means over blocks of [`BLOCK_SIZE`] pixels; blocks at the right and lower edge may be smaller.
pub fn block_means(image: &Image) -> Image {
    let (w, h) = (image.width(), image.height());
    let pixel = |bx: u32, by: u32| {
        let (x0, y0) = (bx * BLOCK_SIZE, by * BLOCK_SIZE);
        let (x1, y1) = ((x0 + BLOCK_SIZE).min(w), (y0 + BLOCK_SIZE).min(h));
        let mut sum = [0f64; 3];
        for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
            for (s, v) in sum.iter_mut().zip(image.pixel(x, y).to_array()) {
                *s += f64::from(v);
            }
        }
        let n = f64::from((x1 - x0) * (y1 - y0));
        Rgb::from(sum.map(|s| (s / n) as f32))
    };
    Image::from_fn(w.div_ceil(BLOCK_SIZE), h.div_ceil(BLOCK_SIZE), pixel)
}

/// The image of `width × height` pixels in which every pixel has the value of its block.
pub fn spread_blocks(blocks: &Image, width: u32, height: u32) -> Image {
    Image::from_fn(width, height, |x, y| blocks.pixel(x / BLOCK_SIZE, y / BLOCK_SIZE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_have_the_means_of_their_pixels() {
        let image = Image::from_fn(20, 17, |x, y| Rgb::new(x as f32, y as f32, 1.0));
        let blocks = block_means(&image);
        assert_eq!((blocks.width(), blocks.height()), (2, 2));
        assert_eq!(blocks.pixel(0, 0), Rgb::new(7.5, 7.5, 1.0));
        assert_eq!(blocks.pixel(1, 1), Rgb::new(17.5, 16.0, 1.0));
        assert_eq!(spread_blocks(&blocks, 20, 17).pixel(16, 3), Rgb::new(17.5, 7.5, 1.0));
    }
}
