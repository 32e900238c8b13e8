//! The stored photon: twenty bytes in Jensen's order.

use super::direction;
use crate::color::{Rgb, rgbe};
use crate::math::Vec3;

/// Positions beyond this are refused, so that a squared distance is always finite.
pub const MAX_COORDINATE: f32 = 1e18;

/// Which light a stored photon carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum PhotonClass {
    /// Reached its first diffuse surface by specular bounces only (LS⁺D).
    Caustic = 0,
    /// Any photon on a diffuse surface.
    Global = 1,
    /// Scattered in a medium.
    Volume = 2,
    /// Not a photon but a precomputed irradiance: power holds W·m⁻², the normal bits the surface [Christensen 1999].
    Irradiance = 3,
}

impl PhotonClass {
    const ALL: [Self; 4] = [Self::Caustic, Self::Global, Self::Volume, Self::Irradiance];
}

/// A photon's sixteen flag bits:
/// 0–1 split axis, 2 side, 3–4 class, 5 mark (first bounce, shadow, or from a narrow lobe), 6–15 octahedral normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Flags(pub u16);

impl Flags {
    const AXIS: u16 = 0b11;
    const SIDE: u16 = 1 << 2;
    const MARK: u16 = 1 << 5;

    /// Flags of a photon that has no place in a tree yet.
    #[inline]
    pub fn new(side: bool, class: PhotonClass, mark: bool, normal: Vec3) -> Self {
        let side = if side { Self::SIDE } else { 0 };
        let mark = if mark { Self::MARK } else { 0 };
        Self(side | (class as u16) << 3 | mark | direction::encode_normal(normal) << 6)
    }

    /// The axis along which the photon's node splits space: 0, 1 or 2.
    #[inline]
    pub fn axis(self) -> usize {
        (self.0 & Self::AXIS) as usize
    }

    #[inline]
    pub(crate) fn with_axis(self, axis: u16) -> Self {
        Self(self.0 & !Self::AXIS | axis)
    }

    /// True when the photon arrived on the side of the surface its geometric normal points to.
    #[inline]
    pub fn side(self) -> bool {
        self.0 & Self::SIDE != 0
    }

    #[inline]
    pub fn class(self) -> PhotonClass {
        PhotonClass::ALL[(self.0 >> 3 & 3) as usize]
    }

    /// First bounce (global photons), from a narrow lobe (indirect photons) or shadow photon (direct light): the map's maker
    /// decides which.
    #[inline]
    pub fn mark(self) -> bool {
        self.0 & Self::MARK != 0
    }

    /// The geometric normal, 3° rms off.
    #[inline]
    pub fn normal(self) -> Vec3 {
        direction::decode_normal(self.0 >> 6)
    }
}

/// A photon as it is stored, 20 bytes [Jensen 2001, section 5.2].
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Photon {
    /// Position in scene space.
    pub position: [f32; 3],
    /// Power (W) as three mantissas and an exponent, see [`rgbe`].
    pub power: [u8; 4],
    /// θ and φ of the direction it came from, see [`direction`].
    pub direction: [u8; 2],
    pub flags: Flags,
}

const _: () = {
    assert!(size_of::<Photon>() == 20 && align_of::<Photon>() == 4);
    assert!(std::mem::offset_of!(Photon, power) == 12);
    assert!(std::mem::offset_of!(Photon, direction) == 16);
    assert!(std::mem::offset_of!(Photon, flags) == 18);
};

/// A photon before packing, or after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonRecord {
    /// Position in scene space.
    pub p: Vec3,
    /// Power, W.
    pub power: Rgb,
    /// Unit direction towards where the photon came from.
    pub wi: Vec3,
    /// Unit geometric normal.
    pub normal: Vec3,
    /// True when `wi` is in the hemisphere of `normal`.
    pub side: bool,
    pub class: PhotonClass,
    /// First bounce, or shadow photon.
    pub mark: bool,
}

/// Why a photon cannot be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Rejected {
    #[error("the position is not finite or beyond 1e18")]
    Position,
    #[error("the power is negative, not finite or beyond 1.7e38")]
    Power,
    #[error("the direction or the normal is not finite")]
    Direction,
}

impl Photon {
    /// Packs a record; `hash` is a fresh 64-bit hash of the photon's path and bounce, used to round the power without bias.
    pub fn pack(record: &PhotonRecord, hash: u64) -> Result<Self, Rejected> {
        Self::pack_words(record, hash).map(|words| Self::from_words(record.p, words))
    }

    /// [`Photon::pack`] but for the position: the power, and the direction with the flags above it, little-endian. Without
    /// calls and with few branches, for loops over many photons.
    #[inline(always)]
    pub(crate) fn pack_words(record: &PhotonRecord, hash: u64) -> Result<[u32; 2], Rejected> {
        if !storable(record.p) {
            return Err(Rejected::Position);
        }
        if !(is_finite(record.wi) & is_finite(record.normal)) {
            return Err(Rejected::Direction);
        }
        let power = rgbe::pack_word(record.power, hash).ok_or(Rejected::Power)?;
        let [theta, phi] = direction::encode(record.wi);
        let flags = Flags::new(record.side, record.class, record.mark, record.normal);
        Ok([power, theta as u32 | (phi as u32) << 8 | (flags.0 as u32) << 16])
    }

    /// The photon of a position and the words of [`Photon::pack_words`].
    #[inline(always)]
    pub(crate) fn from_words(p: Vec3, [power, tail]: [u32; 2]) -> Self {
        let [theta, phi, ..] = tail.to_le_bytes();
        let flags = Flags((tail >> 16) as u16);
        Self { position: p.to_array(), power: power.to_le_bytes(), direction: [theta, phi], flags }
    }

    /// What is left of the record: power unbiased, direction 0.4° and normal 3° rms off.
    pub fn unpack(&self) -> PhotonRecord {
        PhotonRecord {
            p: Vec3::from_array(self.position),
            power: rgbe::unpack(self.power),
            wi: direction::decode(self.direction),
            normal: self.flags.normal(),
            side: self.flags.side(),
            class: self.flags.class(),
            mark: self.flags.mark(),
        }
    }
}

/// True for a position whose squared distances are finite.
#[inline(always)]
pub(crate) fn storable(p: Vec3) -> bool {
    // Written so that a NaN fails the test.
    let fits = |x: f32| x.abs() <= MAX_COORDINATE;
    fits(p.x) & fits(p.y) & fits(p.z)
}

#[inline(always)]
fn is_finite(v: Vec3) -> bool {
    v.x.is_finite() & v.y.is_finite() & v.z.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> PhotonRecord {
        PhotonRecord {
            p: Vec3::new(0.1, -0.2, 0.3),
            power: Rgb::new(1.0, 0.5, 0.0),
            wi: Vec3::new(0.6, 0.0, 0.8),
            normal: Vec3::Z,
            side: true,
            class: PhotonClass::Volume,
            mark: true,
        }
    }

    #[test]
    fn packing_keeps_what_it_promises() {
        for (side, mark) in [(false, false), (true, false), (false, true), (true, true)] {
            for class in PhotonClass::ALL {
                let r = PhotonRecord { side, mark, class, ..record() };
                let u = Photon::pack(&r, 7).expect("a good record").unpack();
                assert_eq!((u.p, u.side, u.mark, u.class, u.normal), (r.p, side, mark, class, Vec3::Z));
                assert_eq!(u.power, r.power);
                assert!(u.wi.dot(r.wi) > 0.9999);
            }
        }
    }

    #[test]
    fn bad_records_are_told_apart() {
        let r = record();
        let nan = Vec3::new(0.0, f32::NAN, 0.0);
        assert_eq!(Photon::pack(&PhotonRecord { p: nan, ..r }, 0), Err(Rejected::Position));
        assert_eq!(Photon::pack(&PhotonRecord { p: Vec3::splat(2e18), ..r }, 0), Err(Rejected::Position));
        assert_eq!(Photon::pack(&PhotonRecord { wi: nan, ..r }, 0), Err(Rejected::Direction));
        assert_eq!(Photon::pack(&PhotonRecord { power: Rgb::splat(-1.0), ..r }, 0), Err(Rejected::Power));
    }

    #[test]
    fn the_axis_does_not_disturb_the_other_flags() {
        let f = Flags::new(true, PhotonClass::Irradiance, true, -Vec3::Y);
        for axis in 0..3 {
            let g = f.with_axis(axis);
            assert_eq!(g.axis(), axis as usize);
            assert_eq!((g.side(), g.class(), g.mark(), g.normal()), (true, PhotonClass::Irradiance, true, -Vec3::Y));
        }
    }
}
