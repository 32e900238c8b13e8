//! `render --serve`: what a viewer is sent is the picture.

mod common;

use std::io::{BufReader, Read};
use std::net::TcpListener;

use common::program::Folder;

const SCENE: &str = r#"<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective">
    <film type="hdrfilm"><integer name="width" value="700"/><integer name="height" value="500"/></film>
    <sampler type="independent"><integer name="sample_count" value="2"/></sampler>
  </sensor>
  <shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>
  <emitter type="constant"/>
</scene>"#;

/// The parts of a packet in tev's protocol: numbers little-endian, names ended by a zero.
struct Packet(std::vec::IntoIter<u8>);

impl Packet {
    /// The next one, unless the sender is gone.
    fn read(from: &mut impl Read) -> Option<Self> {
        let mut length = [0; 4];
        from.read_exact(&mut length).ok()?;
        let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
        from.read_exact(&mut rest).expect("a whole packet");
        Some(Self(rest.into_iter()))
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        std::array::from_fn(|_| self.0.next().expect("more of the packet"))
    }

    fn number(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn name(&mut self) -> String {
        let bytes = self.0.by_ref().take_while(|&b| b != 0).collect();
        String::from_utf8(bytes).expect("a text")
    }
}

#[test]
fn a_viewer_is_sent_the_picture() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("its address");
    let f = Folder::new(SCENE);
    let mut child =
        f.command(&format!("render scene.xml -q -o out.pfm --serve={address}")).spawn().expect("the program starts");
    let mut stream = BufReader::new(listener.accept().expect("the program calls").0);
    let (mut picture, mut created) = (Vec::new(), 0);
    while let Some(mut p) = Packet::read(&mut stream) {
        let [kind, _focus] = p.take();
        assert_eq!(p.name(), "out.pfm");
        if kind == 4 {
            created += 1;
            assert_eq!((p.number(), p.number(), p.number()), (700, 500, 3));
            picture = vec![f32::NAN; 700 * 500 * 3];
            continue;
        }
        assert_eq!((kind, p.number()), (6, 3), "an update of three channels");
        assert_eq!([p.name(), p.name(), p.name()], ["R", "G", "B"]);
        let (x, y, w, h) = (p.number(), p.number(), p.number(), p.number());
        assert_eq!((x, w), (0, 700));
        let layout: [u64; 6] = std::array::from_fn(|_| u64::from_le_bytes(p.take()));
        assert_eq!(layout, [0, 1, 2, 3, 3, 3]);
        for value in &mut picture[(y * 700 * 3) as usize..((y + h) * 700 * 3) as usize] {
            *value = f32::from_le_bytes(p.take());
        }
        assert!(p.0.next().is_none());
    }
    assert!(child.wait().expect("a child").success());
    assert_eq!(created, 1);
    let file: Vec<f32> = f.image("out.pfm").pixels().iter().flat_map(|c| c.to_array()).collect();
    assert_eq!(picture, file);
}

#[test]
fn a_viewer_that_is_not_there_is_missed_before_anything_is_rendered() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("its address");
    drop(listener);
    let f = Folder::new(SCENE);
    f.fails(&format!("render scene.xml -o out.pfm --serve={address}"), 1, &["no viewer answers", "start tev"]);
    assert!(!f.path("out.pfm").exists());
}

#[test]
fn a_viewer_that_leaves_does_not_end_the_render() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("its address");
    let f = Folder::new(SCENE);
    let command = format!("render scene.xml -q -o out.pfm --passes 8 --spp 8 --serve={address}");
    let child = f.command(&command).stderr(std::process::Stdio::piped()).spawn().expect("the program starts");
    drop(listener.accept().expect("the program calls"));
    drop(listener);
    let output = child.wait_with_output().expect("a child");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && told.contains("the viewer is gone"), "{told}");
    assert!(f.path("out.pfm").exists());
}
