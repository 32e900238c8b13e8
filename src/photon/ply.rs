//! Photons as a coloured point cloud, for MeshLab or CloudCompare.

use super::map::PhotonMap;
use crate::color::linear_to_srgb;
use crate::math::Vec3;
use std::io::{self, Write};

/// Writes a binary PLY file: position (through `to_world`), geometric normal, colour of the power scaled to its strongest
/// channel, power in W, and class (0 caustic, 1 global, 2 volume, 3 irradiance).
pub fn write_ply(map: &PhotonMap, to_world: impl Fn(Vec3) -> Vec3, mut out: impl Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment photons\nelement vertex {}", map.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    for name in ["red", "green", "blue"] {
        writeln!(out, "property uchar {name}")?;
    }
    writeln!(out, "property float power\nproperty uchar class\nend_header")?;
    for i in 0..map.len() as u32 {
        for v in to_world(map.position(i)).to_array().into_iter().chain(map.normal(i).to_array()) {
            out.write_all(&v.to_le_bytes())?;
        }
        let power = map.power(i);
        let strongest = power.max_channel().max(f32::MIN_POSITIVE);
        out.write_all(&power.to_array().map(|v| (linear_to_srgb(v / strongest) * 255.0).round() as u8))?;
        out.write_all(&(power.r + power.g + power.b).to_le_bytes())?;
        out.write_all(&[map.flags(i).class() as u8])?;
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::photon::{Photon, PhotonClass, PhotonRecord};

    #[test]
    fn a_point_cloud_of_two() {
        let record = |x: f32, power| PhotonRecord {
            p: Vec3::new(x, 0.0, 0.5),
            power,
            wi: Vec3::Z,
            normal: -Vec3::Y,
            side: false,
            class: PhotonClass::Volume,
            mark: false,
        };
        let photons = [record(1.0, Rgb::new(4.0, 2.0, 0.0)), record(0.0, Rgb::BLACK)];
        let map = PhotonMap::build(photons.iter().map(|r| Photon::pack(r, 0).expect("good")).collect());
        let mut bytes = Vec::new();
        write_ply(&map, |p| p * 10.0, &mut bytes).expect("memory takes everything");
        let marker = b"end_header\n";
        let end = bytes.windows(marker.len()).position(|w| w == marker).expect("a header") + marker.len();
        let header = std::str::from_utf8(&bytes[..end]).expect("the header is text");
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n") && header.contains("element vertex 2\n"));
        assert_eq!(bytes.len() - end, 2 * 32);
        // The second photon in emission order is the first one from the left; the root of two is the right one.
        let first = &bytes[end..end + 32];
        let float = |i: usize| f32::from_le_bytes(first[4 * i..4 * i + 4].try_into().expect("four bytes"));
        assert_eq!([float(0), float(1), float(2), float(3), float(4), float(5)], [10.0, 0.0, 5.0, 0.0, -1.0, 0.0]);
        assert_eq!(&first[24..27], [255, 188, 0]);
        assert_eq!(&first[27..31], 6f32.to_le_bytes());
        assert_eq!(first[31], 2);
    }
}
