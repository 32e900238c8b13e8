//! Arguments as typed.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};

use super::values::{bytes, count, duration, key_value, need, positive, range, target_error};
use crate::accel::{AccelKind, AccelOptions, Mode, Quality};
use crate::integrator::Layer;
use crate::scene::NeedOverride;

/// A photon-mapping renderer for the CPU that reads Mitsuba scene files.
#[derive(Debug, Parser)]
#[command(name = "caustica", version, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene file to an image.
    Render(Box<RenderArgs>),
    /// Measure how far one image is from another.
    Compare(CompareArgs),
    /// Measure how wrong the picture of each method is after how long, and write a report.
    Converge(Box<ConvergeArgs>),
    /// Make a picture to measure others by, from two methods that must agree.
    Reference(Box<ReferenceArgs>),
    /// Add up checkpoints of different passes of one render.
    Merge(MergeArgs),
    /// Say what a scene file holds and what would render it.
    Info(InfoArgs),
    /// Measure the ray-query back ends on a scene or mesh.
    Bench(BenchArgs),
    /// Keep photon maps in files.
    Map(MapArgs),
    /// Make a mesh of any size, to render or to measure with.
    Scene(GenerateArgs),
    /// Render extreme scenes with known answers and say which come out right.
    Verify(VerifyArgs),
}

/// The ray-query back end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum AccelArg {
    /// Embree where it is built in, but the Rust BVH for up to 48 triangles and 2 other shapes; else the Rust BVH.
    #[default]
    Auto,
    Embree,
    Bvh,
}

impl From<AccelArg> for AccelKind {
    fn from(a: AccelArg) -> Self {
        match a {
            AccelArg::Auto => AccelKind::Auto,
            AccelArg::Embree => AccelKind::Embree,
            AccelArg::Bvh => AccelKind::Bvh,
        }
    }
}

/// How much time building the tree of ray queries may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    /// Quick to build: for a few samples of a large mesh.
    Fast,
    #[default]
    Default,
    /// Slow to build, faster where large triangles lie among small ones. Of Embree's trees, two of this quality need not be
    /// the same.
    Quality,
}

/// How triangles are tested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ModeArg {
    /// No ray slips through between triangles that share an edge.
    #[default]
    Robust,
    /// Faster, in single precision throughout; rays at edges may slip through.
    Fast,
}

/// How the ray-query back ends build and search their trees.
#[derive(Clone, Copy, Debug, Args)]
pub struct TreeArgs {
    /// How much time building the tree of ray queries may take.
    #[arg(long, value_enum, default_value_t)]
    pub accel_quality: QualityArg,
    /// How triangles are tested.
    #[arg(long, value_enum, default_value_t)]
    pub accel_mode: ModeArg,
}

impl From<TreeArgs> for AccelOptions {
    fn from(a: TreeArgs) -> Self {
        let quality = match a.accel_quality {
            QualityArg::Fast => Quality::Fast,
            QualityArg::Default => Quality::Default,
            QualityArg::Quality => Quality::High,
        };
        let mode = match a.accel_mode {
            ModeArg::Robust => Mode::Robust,
            ModeArg::Fast => Mode::Fast,
        };
        Self { quality, mode }
    }
}

/// What every command that reads a scene takes.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Mitsuba scene file (XML).
    pub scene: PathBuf,
    /// Override a `<default>` of the scene file; may be given many times.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE", value_parser = key_value)]
    pub defines: Vec<(String, String)>,
    /// Ray-query back end.
    #[arg(long, value_enum, default_value_t)]
    pub accel: AccelArg,
    #[command(flatten)]
    pub tree: TreeArgs,
    /// Film width in pixels; the height follows if it is not given.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub width: Option<u32>,
    /// Film height in pixels; the width follows if it is not given.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub height: Option<u32>,
    /// Make something whether or not the scene needs it, or leave it out, for example caustics=off; may be given many
    /// times. What there is to decide is told by `caustica info`.
    #[arg(long = "need", value_name = "ITEM=on|off", value_parser = need)]
    pub needs: Vec<NeedOverride>,
    /// Worker threads; by default one for each processor.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
}

/// What a render can write beside the colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Aov {
    /// Variance of each pixel, from the differences between passes.
    Variance,
    /// Bias of each pixel, from photon maps read more and less widely.
    Bias,
    /// Radiance of all photon maps seen directly.
    Photons,
    /// Radiance of the caustic map.
    Caustic,
    /// Radiance of the global map.
    Global,
    /// Light of no photon.
    Direct,
    /// Photons stored per unit of area.
    Density,
    /// Where the irradiance cache has its records.
    Cache,
}

impl Aov {
    /// What it shows of photon maps, if it does.
    pub fn layer(self) -> Option<Layer> {
        Some(match self {
            Self::Variance | Self::Bias => return None,
            Self::Photons => Layer::Photons,
            Self::Caustic => Layer::Caustic,
            Self::Global => Layer::Global,
            Self::Direct => Layer::Direct,
            Self::Density => Layer::Density,
            Self::Cache => Layer::Cache,
        })
    }
}

#[derive(Debug, Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Image to write (.exr, .png, .hdr, .pfm); may be given many times. Default: the scene's name with .exr.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
    /// Integrator, in place of the scene's: path, direct, photonmapper, ppm, sppm, ptracer, bdpt, vcm; or auto, which tries
    /// path, sppm, vcm and, where those promise much work, photonmapper, and goes on with the one that promises the least error.
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// Samples per pixel, in place of the scene's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 32))]
    pub spp: Option<u64>,
    /// Photons wanted in each photon map, in place of the scene's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=1 << 32))]
    pub photons: Option<u64>,
    /// Use the photon maps in this file (of `map build`) instead of shooting photons.
    #[arg(long, value_name = "FILE")]
    pub photon_map: Option<PathBuf>,
    /// Bytes that the photon maps of a pass may take, for example 512MB or 2GB; sets the number of photons.
    #[arg(long, value_name = "BYTES", value_parser = bytes, conflicts_with = "photons")]
    pub photon_memory: Option<u64>,
    /// Passes to share the samples among; photon maps are made anew for each.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 32))]
    pub passes: Option<u64>,
    /// Camera samples per pixel in each pass of ppm and sppm, which see the same photons: more where it is not photons that
    /// make the noise. auto sees to that itself; --spp and --passes together say it, too.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 16))]
    pub samples_per_pass: Option<u64>,
    /// Make only these of the render's passes, for example 0..64; `caustica merge` adds up the checkpoints of all.
    #[arg(long, value_name = "FROM..TO", value_parser = range)]
    pub pass_range: Option<Range<u64>>,
    /// Keep what the finished passes have found in this file, to go on from with --resume.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Time between two checkpoints; one more is written at the end.
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "60s", requires = "checkpoint")]
    pub every: Duration,
    /// Go on from a checkpoint of the same scene and options; the result has the bits of an unbroken run.
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// Write the image so far after each pass that ends when this much time has gone since the last one.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub write_every: Option<Duration>,
    /// Show the image so far in tev, which must be running; its address, if it listens elsewhere.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, require_equals = true,
          default_missing_value = super::serve::TEV_ADDRESS)]
    pub serve: Option<String>,
    /// Stop after the pass that is running when this time is over, for example 30s or 5min.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub time: Option<Duration>,
    /// Stop when the render's own estimate of this error is below the given value, for example relmse=1e-3. It counts noise
    /// and, where photons are used, blur: every fourth pass is read again for that.
    #[arg(long, value_name = "relmse=VALUE", value_parser = target_error)]
    pub target_error: Option<f64>,
    /// Layers to write into .exr beside the colour: variance (of each pixel and, as blockvariance, of each block of
    /// 16 x 16), bias (of photon maps and of merging; doubles the time of camera passes); and of photonmapper's maps, seen
    /// directly: photons (all maps), caustic, global, direct (what is not of photons), density (photons per unit of area),
    /// cache (records of the irradiance cache). Beside a .png these last become pictures FILE.LAYER.png of their own.
    #[arg(long, value_enum, value_name = "LAYER", value_delimiter = ',')]
    pub aov: Vec<Aov>,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Dim samples above this radiance: fireflies go, and with them some light, which is reported. Off by default.
    #[arg(long, value_name = "RADIANCE", value_parser = positive)]
    pub clamp: Option<f32>,
    /// Exposure of .png output in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Write .exr with 32-bit floats rather than 16-bit ones.
    #[arg(long)]
    pub float: bool,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object at the end instead of text.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Image to judge.
    pub image: PathBuf,
    /// Image to judge it by.
    pub reference: PathBuf,
    /// Error image to write: each pixel's relative error in false colour over a scale bar.
    #[arg(long, value_name = "OUT.png")]
    pub heatmap: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// The ray-query back ends to verify.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum VerifyAccel {
    /// Every back end of this build.
    #[default]
    Both,
    Embree,
    Bvh,
}

#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// Case to run, by default all; may be given many times.
    #[arg(long = "case", value_name = "NAME", num_args = 1..)]
    pub cases: Vec<String>,
    /// Name all cases and stop.
    #[arg(long)]
    pub list: bool,
    /// Ray-query back ends.
    #[arg(long, value_enum, default_value_t)]
    pub accel: VerifyAccel,
    /// Integrators, separated by commas.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "all")]
    pub integrators: Vec<String>,
    /// Independent renders behind each number.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u64).range(2..=1 << 16))]
    pub seeds: u64,
    /// Leave out what takes long.
    #[arg(long)]
    pub fast: bool,
    /// Folder for the table as HTML, CSV and Markdown, and for the plot of stiffness.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print one JSON object at the end instead of text.
    #[arg(long)]
    pub json: bool,
    /// Worker threads; by default one for each processor.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
}

#[derive(Debug, Args)]
pub struct ConvergeArgs {
    /// Mitsuba scene file (XML).
    pub scene: PathBuf,
    /// Integrators to compare; by default all that find all light.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub integrators: Vec<String>,
    /// Ray-query back ends to compare.
    #[arg(long, value_enum, value_name = "NAME", value_delimiter = ',', default_value = "auto")]
    pub accel: Vec<AccelArg>,
    /// Picture to measure by; without it one is made first, as the command `reference` does.
    #[arg(long, value_name = "REF.exr")]
    pub reference: Option<PathBuf>,
    /// Use a reference whose header names another scene or other defines.
    #[arg(long)]
    pub trust_reference: bool,
    /// Time for making the reference where none is given; by default 20 times the time of one run.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub reference_time: Option<Duration>,
    /// Time of each run; there is one for each integrator, back end and seed.
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "60s")]
    pub time: Duration,
    /// End runs after so many passes rather than by time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 32), conflicts_with = "time")]
    pub passes: Option<u64>,
    /// Camera samples per pixel in each pass of ppm and sppm, in place of the scene's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 16))]
    pub samples_per_pass: Option<u64>,
    /// Runs of each integrator, with seeds one after the other.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000), default_value_t = 5)]
    pub seeds: u64,
    /// The first seed.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Folder for report.html, report.json, convergence.csv and the plots; by default the scene's name with -converge.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Exposure of the pictures in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Override a `<default>` of the scene file; may be given many times.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE", value_parser = key_value)]
    pub defines: Vec<(String, String)>,
    /// Film width in pixels; the height follows if it is not given.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub width: Option<u32>,
    /// Film height in pixels; the width follows if it is not given.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub height: Option<u32>,
    /// Worker threads; by default one for each processor.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct ReferenceArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// File to write; its layers hold the variance.
    #[arg(short, long, value_name = "REF.exr")]
    pub output: PathBuf,
    /// The two integrators; by default path and one that starts at the lights.
    #[arg(long, value_name = "NAME", value_delimiter = ',', num_args = 1..=2)]
    pub methods: Vec<String>,
    /// Time of both together.
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "10min")]
    pub time: Duration,
    /// End after so many passes of each rather than by time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(8..=1 << 32), conflicts_with = "time")]
    pub passes: Option<u64>,
    /// Seed of the first integrator; the second has the next.
    #[arg(long, value_name = "N", default_value_t = 1_000_001)]
    pub seed: u64,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Predict the memory instead, without loading: from the scene file and the headers of the meshes and pictures that it
    /// names (of OBJ files, which have none, lines are counted). Warns when the machine has less to give. SCENE may be a
    /// mesh file.
    #[arg(long)]
    pub predict: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// The back ends to measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum BenchAccel {
    /// Every one that this build has.
    #[default]
    All,
    Embree,
    Bvh,
}

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Mitsuba scene file (XML), or a mesh (.ply, .obj, .serialized), which is put under a white sky.
    pub scene: PathBuf,
    /// Override a `<default>` of the scene file; may be given many times.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE", value_parser = key_value)]
    pub defines: Vec<(String, String)>,
    /// Ray-query back ends.
    #[arg(long, value_enum, default_value_t)]
    pub accel: BenchAccel,
    #[command(flatten)]
    pub tree: TreeArgs,
    /// Classes of rays: primary, shadow, diffuse, gather, photon. Default: all.
    #[arg(long, value_name = "CLASS,…", value_delimiter = ',')]
    pub rays: Vec<String>,
    /// Rays of each class.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 26), default_value_t = 1 << 19)]
    pub count: u32,
    /// Times that each class is measured; the median counts.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000), default_value_t = 5)]
    pub rounds: u32,
    /// Samples per pixel of a whole render with each back end; 0 leaves it out.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=1 << 32), default_value_t = 4)]
    pub spp: u64,
    /// Integrator of the whole render, in place of the scene's.
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// Seed of the rays.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Worker threads; by default one for each processor.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct MergeArgs {
    /// Checkpoints of one scene and plan, of passes that do not overlap.
    #[arg(required = true)]
    pub checkpoints: Vec<PathBuf>,
    /// Image (.exr, .png, .hdr, .pfm) or checkpoint (any other name) to write; may be given many times.
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
    /// Exposure of .png output in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Write .exr with 32-bit floats rather than 16-bit ones.
    #[arg(long)]
    pub float: bool,
}

#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(subcommand)]
    pub command: MapCommand,
}

#[derive(Debug, Subcommand)]
pub enum MapCommand {
    /// Shoot the photon maps of a scene into a file, for `render --photon-map`.
    Build(MapBuildArgs),
    /// Say what a photon-map file holds.
    Info(MapInfoArgs),
    /// Write the photons as a coloured point cloud.
    Export(MapExportArgs),
}

#[derive(Debug, Args)]
pub struct MapBuildArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Photon-map file to write (.cpm).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Photons wanted in each map, in place of the scene's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=1 << 32))]
    pub photons: Option<u64>,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct MapInfoArgs {
    /// Photon-map file.
    pub map: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct MapExportArgs {
    /// Photon-map file.
    pub map: PathBuf,
    /// Which of its maps; the first if not given.
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// PLY file to write, in the coordinates of the scene file.
    #[arg(short, long, alias = "ply", value_name = "FILE")]
    pub output: PathBuf,
}

/// The meshes that can be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GeneratedMesh {
    /// Mountains over the square from -1 to 1 in x and y, heights along z.
    Terrain,
    /// A unit sphere with bumps.
    DisplacedSphere,
    /// Spheres on spheres, nine on each.
    Sphereflake,
    /// A lone peak over the square from -1 to 1 in x and y, heights along z.
    Mountain,
    /// A brandy glass that stands on z = 0, 2.8 high: where glass meets air.
    Snifter,
    /// Where the brandy glass meets its drink.
    SnifterWet,
    /// The surface of the drink.
    SnifterDrink,
}

#[derive(Debug, Args)]
pub struct GenerateArgs {
    #[arg(value_enum)]
    pub mesh: GeneratedMesh,
    /// Triangles wanted at least, for example 2M or 500k.
    #[arg(long, value_name = "N", value_parser = count, default_value = "1M")]
    pub triangles: u64,
    /// Seed of the shape.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// PLY file to write.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
