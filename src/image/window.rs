use glam::Vec2;

/// The pixels that a camera sees: a film and the part of it that is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilmWindow {
    /// Width and height of the whole film in pixels.
    pub size: (u32, u32),
    /// Left and top of the crop window in the film.
    pub crop_offset: (u32, u32),
    /// Width and height of the crop window.
    pub crop_size: (u32, u32),
}

impl FilmWindow {
    /// The whole film.
    pub fn full(width: u32, height: u32) -> Self {
        Self { size: (width, height), crop_offset: (0, 0), crop_size: (width, height) }
    }

    /// Pixels of the crop window.
    pub fn pixels(&self) -> u64 {
        u64::from(self.crop_size.0) * u64::from(self.crop_size.1)
    }

    /// The same view in at most so many pixels, give or take the rounding of its sides.
    pub fn shrunk(&self, most_pixels: u64) -> Self {
        if self.pixels() <= most_pixels {
            return *self;
        }
        let scale = (most_pixels as f64 / self.pixels() as f64).sqrt();
        let side = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
        let (w, h) = (side(self.size.0), side(self.size.1));
        let part = |offset: u32, size: u32, whole: u32| {
            let offset = ((f64::from(offset) * scale) as u32).min(whole - 1);
            (offset, side(size).min(whole - offset))
        };
        let ((x, cw), (y, ch)) =
            (part(self.crop_offset.0, self.crop_size.0, w), part(self.crop_offset.1, self.crop_size.1, h));
        Self { size: (w, h), crop_offset: (x, y), crop_size: (cw, ch) }
    }

    /// Width over height of the whole film.
    pub fn aspect(&self) -> f64 {
        self.size.0 as f64 / self.size.1 as f64
    }

    /// True for film positions (pixels of the whole film) inside the crop window.
    #[inline]
    pub fn contains(&self, film_pos: Vec2) -> bool {
        let low = Vec2::new(self.crop_offset.0 as f32, self.crop_offset.1 as f32);
        let high = low + Vec2::new(self.crop_size.0 as f32, self.crop_size.1 as f32);
        film_pos.cmpge(low).all() && film_pos.cmplt(high).all()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shrunk_window_shows_the_same_part_of_the_film() {
        let window = FilmWindow { size: (4000, 2000), crop_offset: (1000, 500), crop_size: (2000, 1000) };
        let small = window.shrunk(5000);
        assert_eq!(small, FilmWindow { size: (200, 100), crop_offset: (50, 25), crop_size: (100, 50) });
        assert_eq!(small.shrunk(5000), small);
        // Degenerate films keep a pixel.
        let line = FilmWindow::full(1 << 20, 1).shrunk(100);
        assert!(line.size.1 == 1 && line.crop_size.0 <= line.size.0 && line.crop_size.1 == 1);
        let corner = FilmWindow { size: (1000, 1000), crop_offset: (999, 999), crop_size: (1, 1) };
        assert_eq!(corner.shrunk(1), corner);
    }
}
