//! Arguments of commands that make figures.

use std::path::PathBuf;

use clap::Args;
use hlod_compress::Unit;
use hlod_render::figure::scale::{parse_dpi, parse_reduction};
use hlod_render::section::Plane;

use super::args::{self, DrawArgs, JsonArgs};
use super::section::plane;

/// Pictures for print.
#[derive(Args)]
pub struct FigureArgs {
    /// Parallel projection: nothing is smaller for being farther away.
    #[arg(long)]
    pub ortho: bool,
    /// Length on paper : length of the statue, as in 1:5; needs --ortho.
    #[arg(long, value_name = "P:S", value_parser = parse_reduction, requires = "ortho")]
    pub scale: Option<f64>,
    /// Pixels in an inch of paper, which the file says too [default with --scale: 300].
    #[arg(long, value_name = "DPI", value_parser = parse_dpi)]
    pub dpi: Option<f64>,
    /// Unit of the scan's coordinates, where the file does not say it.
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    pub unit: Option<Unit>,
    /// Leave the background transparent.
    #[arg(long)]
    pub transparent: bool,
    /// Draw a bar of a round length at the lower left.
    #[arg(long)]
    pub scale_bar: bool,
    /// A line of text at the lower left.
    #[arg(long, value_name = "TEXT")]
    pub caption: Option<String>,
}

#[derive(Args)]
pub struct PlateArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// Front, left and so on are as this session says how the statue stands [default: as the file says].
    #[arg(long, value_name = "JSON")]
    pub session: Option<PathBuf>,
    /// The PNG or TIFF file (.tif) to write; an existing one is replaced.
    #[arg(long, short)]
    pub output: PathBuf,
    /// Length on paper : length of the statue, as in 1:5.
    #[arg(long, value_name = "P:S", value_parser = parse_reduction)]
    pub scale: f64,
    /// Pixels in an inch of paper.
    #[arg(long, value_name = "DPI", value_parser = parse_dpi, default_value = "300")]
    pub dpi: f64,
    /// Which views: some of front,left,back,right,top,bottom. Where they lie is as drawings have it.
    #[arg(long, value_name = "VIEWS", default_value = "front,left,back,right,top")]
    pub views: String,
    /// A section beside the views, as of the command section: NX,NY,NZ,OFFSET or x=, y=, z=.
    #[arg(long, value_name = "PLANE", value_parser = plane, allow_hyphen_values = true)]
    pub section: Option<Plane>,
    /// Unit of the scan's coordinates, where the file does not say it.
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    pub unit: Option<Unit>,
    /// Title below the views [default: the file's name].
    #[arg(long)]
    pub title: Option<String>,
    /// No white paper.
    #[arg(long)]
    pub transparent: bool,
    #[command(flatten)]
    pub precision: args::PrecisionArgs,
    /// Shadows, as of shot.
    #[arg(long, value_enum, default_value = "none")]
    pub shadow: args::ShadowArg,
    #[command(flatten)]
    pub map: args::MapArgs,
    #[command(flatten)]
    pub enhance: args::EnhanceArgs,
    /// Average N × N samples a pixel, for smooth edges.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub supersampling: u32,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
pub struct TurntableArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// Front, left and so on are as this session says how the statue stands [default: as the file says].
    #[arg(long, value_name = "JSON")]
    pub session: Option<PathBuf>,
    /// The folder to write; there must not be any yet, or an empty one.
    #[arg(long, short)]
    pub output: PathBuf,
    /// How many pictures for one turn.
    #[arg(long, default_value_t = 36, value_parser = clap::value_parser!(u32).range(1..=9999))]
    pub frames: u32,
    /// How far above the horizon the camera is, in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 10.0, value_parser = elevation, allow_hyphen_values = true)]
    pub elevation: f64,
    /// Parallel projection, at one scale.
    #[arg(long)]
    pub ortho: bool,
    /// Leave the background transparent.
    #[arg(long)]
    pub transparent: bool,
    #[command(flatten)]
    pub draw: DrawArgs,
    /// Average N × N samples a pixel, for smooth edges.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub supersampling: u32,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
#[command(after_help = "\
The lights are parallel, evenly spread over the hemisphere before the camera on a Fibonacci spiral, and \
replace --light. Pictures are of Lambert's law alone, without highlights and ambient light, whatever shot \
shows, and coded by the sRGB curve: undo it before values are compared. light-dome.lp has the number of \
pictures, then for each its name and the light's unit vector: x right, y up, z towards the viewer.")]
pub struct LightDomeArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// The folder to write; there must not be any yet, or an empty one.
    #[arg(long, short)]
    pub output: PathBuf,
    /// How many lights.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=9999))]
    pub lights: u32,
    /// From where, as of shot.
    #[arg(long, default_value = "front", allow_hyphen_values = true)]
    pub camera: String,
    /// Parallel projection.
    #[arg(long)]
    pub ortho: bool,
    #[command(flatten)]
    pub draw: DrawArgs,
    /// Average N × N samples a pixel, for smooth edges.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub supersampling: u32,
    #[command(flatten)]
    pub json: JsonArgs,
}

fn unit(text: &str) -> Result<Unit, String> {
    text.parse()
}

fn elevation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (-85.0..=85.0).contains(&value) => Ok(value),
        _ => Err("expected -85 to 85 degrees".into()),
    }
}
