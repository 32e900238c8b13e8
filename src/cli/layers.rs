//! Layers of a render as pictures of their own, where the format of the picture holds none.

use std::path::{Path, PathBuf};

use super::CliError;
use super::args::RenderArgs;
use crate::image::diff::{HeatmapOptions, heatmap};
use crate::image::{Format, Image, WriteOptions};
use crate::integrator::Layer;

/// The layers of photon maps that were asked for, each once.
pub fn wanted(a: &RenderArgs) -> Vec<Layer> {
    Layer::ALL.into_iter().filter(|&l| a.aov.iter().any(|aov| aov.layer() == Some(l))).collect()
}

/// Writes the layers of `image` beside every .png among `outputs`: colours as they are, numbers in false colour over a
/// scale bar. Returns the files.
pub fn write_beside(
    outputs: &[PathBuf],
    image: &Image,
    layers: &[Layer],
    options: &WriteOptions,
) -> Result<Vec<PathBuf>, CliError> {
    let mut written = Vec::new();
    for path in outputs.iter().filter(|p| Format::from_path(p) == Some(Format::Png)) {
        for &layer in layers {
            let Some((picture, options)) = picture(image, layer, options) else { continue };
            let file = beside(path, layer);
            crate::image::write(&file, &picture, &options).map_err(CliError::Output)?;
            written.push(file);
        }
    }
    Ok(written)
}

/// `image.png` becomes `image.LAYER.png`.
fn beside(path: &Path, layer: Layer) -> PathBuf {
    path.with_extension(format!("{}.png", layer.name()))
}

fn picture(image: &Image, layer: Layer, options: &WriteOptions) -> Option<(Image, WriteOptions)> {
    let (width, height) = (image.width(), image.height());
    if !layer.is_number() {
        return Some((Image::rgb(width, height, image.layer(layer.name())?), *options));
    }
    let values: Vec<f64> = image.channel(&format!("{}.Y", layer.name()))?.iter().map(|&v| v.into()).collect();
    // Densities differ by factors.
    let scale = HeatmapOptions { range: None, log: layer == Layer::Density };
    Some((heatmap(&values, width, height, &scale), WriteOptions::default()))
}
