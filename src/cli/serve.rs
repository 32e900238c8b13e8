//! The picture so far in a running tev, through its network protocol.

use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use super::CliError;
use crate::image::Image;
use crate::render::Session;

/// Where tev listens unless it is told otherwise.
pub const TEV_ADDRESS: &str = "127.0.0.1:14158";

/// Time for the viewer to answer, and to take what is sent to it.
const PATIENCE: Duration = Duration::from_secs(5);

/// Time between two pictures.
const EVERY: Duration = Duration::from_secs(1);

/// Pixels sent at once.
const PIXELS_PER_PACKET: u32 = 1 << 18;

const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// A viewer that shows the picture as it grows.
///
/// When it goes away it is told once, and the render goes on without it.
pub struct Viewer {
    client: Option<TevClient>,
    name: String,
    last: Option<Instant>,
}

impl Viewer {
    /// Connects to the viewer at `address` (host and port); `name` is what it calls the picture.
    pub fn connect(address: &str, name: String) -> Result<Self, CliError> {
        let failed = |e: &dyn std::fmt::Display| {
            CliError::Failed(format!("no viewer answers at {address} ({e}): start tev first, or name where it listens"))
        };
        let mut found = address.to_socket_addrs().map_err(|e| failed(&e))?;
        let first = found.next().ok_or_else(|| failed(&"no such host"))?;
        let stream = TcpStream::connect_timeout(&first, PATIENCE).map_err(|e| failed(&e))?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(|e| failed(&e))?;
        Ok(Self { client: Some(TevClient::wrap(stream)), name: name.replace('\0', ""), last: None })
    }

    /// Shows the picture so far, unless it did so a moment ago.
    pub fn after_pass(&mut self, session: &Session, last: bool) {
        let due = last || self.last.is_none_or(|t| t.elapsed() >= EVERY);
        if self.client.is_some() && due {
            self.show(&session.image());
        }
    }

    fn show(&mut self, image: &Image) {
        let Some(client) = &mut self.client else { return };
        let first = self.last.is_none();
        if let Err(e) = send(client, &self.name, image, first) {
            eprintln!("caustica: warning: the viewer is gone ({e}); rendering goes on without it");
            self.client = None;
        }
        self.last = Some(Instant::now());
    }
}

/// Sends a picture in bands of whole rows.
fn send(client: &mut TevClient, name: &str, image: &Image, first: bool) -> std::io::Result<()> {
    let (width, height) = (image.width(), image.height());
    if first {
        client.send(PacketCreateImage {
            image_name: name,
            grab_focus: true,
            width,
            height,
            channel_names: &CHANNELS,
        })?;
    }
    let rows = (PIXELS_PER_PACKET / width).clamp(1, height);
    for (band, pixels) in image.pixels().chunks((rows * width) as usize).enumerate() {
        let data: Vec<f32> = pixels.iter().flat_map(|c| c.to_array()).collect();
        client.send(PacketUpdateImage {
            image_name: name,
            grab_focus: false,
            channel_names: &CHANNELS,
            channel_offsets: &[0, 1, 2],
            channel_strides: &[3, 3, 3],
            x: 0,
            y: band as u32 * rows,
            width,
            height: pixels.len() as u32 / width,
            data: &data,
        })?;
    }
    Ok(())
}
