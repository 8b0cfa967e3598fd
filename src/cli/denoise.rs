//! `cumulo denoise`: noisy pictures, of sequences in time.

use super::args::read_as;
use super::args::single::Overwrite;
use super::memory::Memory;
use crate::app::denoise::{Cuts, DenoiseSettings, Direction, Filter, Guide, Motion};
use crate::denoise::Settings;
use crate::formats::sequence::Frames;
use std::path::PathBuf;

/// Denoise a sequence of pictures in time, or a single picture
///
/// Colors are compared along the motion of what they show, over the frames before and, with wrls2, after; a single
/// picture is denoised by its own pixels alone. Each view of a stereo picture is denoised. All that is not denoised
/// passes through as it is, attributes included. A frame that cannot be read, or has no finite pixel, is named, and
/// the others go on.
#[derive(Debug, clap::Args)]
struct DenoiseArgs {
    /// Noisy frames, 'in.####.exr' or in.%04d.exr, or one picture
    input: PathBuf,
    /// Denoised frames, numbered as those that go in: 'out.####.exr'; of one picture one name
    #[arg(long, short, value_name = "OUT.####.exr")]
    output: PathBuf,
    /// Frames to write: A, A-B or A-BxSTEP (default: all that there are); those around are read to learn from
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    /// Way to denoise
    #[arg(long, value_enum, default_value_t)]
    method: Filter,
    /// Where motion comes from: auto takes the layer Vector if there is one; layer:NAME; files:'motion.####.exr' of
    /// `cumulo motion`; vdb:V.vdb,CAPTURE computes as `cumulo motion` does, from a volume, or vdb:V.####.vdb,CAPTURE,
    /// and the capture with its cameras; none for pictures at rest
    #[arg(long, value_name = "FROM", default_value = "auto")]
    motion: Motion,
    /// Layers of color to denoise, comma-separated, in all views (default: the beauty)
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    layers: Vec<String>,
    /// Guide to the outlines that must stay sharp, for wrls2
    #[arg(long, value_enum, default_value_t)]
    guide: Guide,
    /// Denoise the layers half_a and half_b, which `render --aov halves` writes, apart from each other, and write their
    /// mean. Its error is known then, without a reference and whatever moves, in twice the time
    #[arg(long, conflicts_with_all = ["layers", "alpha", "confidence", "error"])]
    halves: bool,
    /// Denoise the alpha of these layers, too
    #[arg(long)]
    alpha: bool,
    /// Add the layer `confidence`: the number of samples that each pixel rests on
    #[arg(long)]
    confidence: bool,
    /// Add the layers `noise` and `error`, for wrls2: the root mean square of the noise that came in and of the error
    /// that is left around each pixel, in the units of the colors, as the frames before and after tell them; -1 where
    /// unknown
    #[arg(long)]
    error: bool,
    /// Frames that a frame learns from, for wrls2
    #[arg(long, value_enum, default_value_t)]
    direction: Direction,
    /// Work in chunks of N frames that do not depend on each other
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    chunk: Option<u32>,
    /// Frames before and after a chunk, or after a frame, that are read to learn from
    #[arg(long, value_name = "M", default_value_t = 12)]
    overlap: u32,
    /// Skip frames that are there, made by the same settings, unless the picture or its motion has changed since;
    /// changes of the frames around, of which a frame learns, do not count
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Frames at which another shot begins: auto finds them, none has none
    #[arg(long, value_enum, default_value_t)]
    cuts: Cuts,
    /// Share of the history in the feature, for wrls, rls and ema
    #[arg(long, value_name = "ALPHA", default_value_t = Settings::default().history)]
    history: f32,
    /// Bandwidth of the distance between color and feature above which colors are outliers, for wrls
    #[arg(long, value_name = "H", default_value_t = Settings::default().bandwidth)]
    bandwidth: f32,
    /// Share of what was learned that is kept from frame to frame, for wrls and rls
    #[arg(long, value_name = "LAMBDA", default_value_t = Settings::default().forgetting)]
    forgetting: f32,
    /// Standard deviation in pixels of the weights of the models around a pixel, for wrls and rls
    #[arg(long, value_name = "PIXELS", default_value_t = Settings::default().spread)]
    spread: f32,
    /// Bandwidth of the distance between the features of neighbours, for wrls and rls
    #[arg(long, value_name = "H", default_value_t = Settings::default().likeness)]
    likeness: f32,
    #[command(flatten)]
    memory: Memory,
}

impl From<DenoiseArgs> for DenoiseSettings {
    fn from(args: DenoiseArgs) -> Self {
        let DenoiseArgs { history, bandwidth, forgetting, spread, likeness, .. } = args;
        Self {
            input: args.input,
            output: args.output,
            frames: args.frames,
            method: args.method,
            motion: args.motion,
            layers: args.layers,
            guide: args.guide,
            halves: args.halves,
            alpha: args.alpha,
            confidence: args.confidence,
            error: args.error,
            direction: args.direction,
            chunk: args.chunk,
            overlap: args.overlap,
            resume: args.resume,
            overwrite: args.overwrite.into(),
            cuts: args.cuts,
            published: Settings { history, bandwidth, forgetting, spread, likeness },
            limits: args.memory.limits(),
        }
    }
}

read_as!(DenoiseSettings, DenoiseArgs);
