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
