//! Stacks of TIFF: the pages of one file, or one file for each slice, in a folder or by a pattern.
//!
//! A page's columns run along x and its rows along y, the first row at y = 0; pages follow each other along z.
//! Microscopes' files with several channels give a grid for each. Spacings are taken from ImageJ's and OME's
//! descriptions; others' resolutions are those of a print, and say nothing of a volume.

mod description;
mod listing;
mod page;

use super::image::{About, Header, Image, Slices, Values};
use super::options::Options;
use super::placement;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::math::Affine;
use description::{Description, Order};
use glam::DVec3;
pub(crate) use listing::is_stack;
use page::{Kind, Pages};
use std::path::{Path, PathBuf};

/// Largest number of channels.
const MOST_CHANNELS: usize = 64;

/// Extensions of the files of a stack.
pub(crate) use listing::files;

pub(crate) const ENDINGS: &[&str] = &["tif", "tiff"];

/// Says whether a file begins as TIFFs do, those of 64 bits included.
pub(crate) fn is_tiff(start: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| start.starts_with(*magic))
}

/// Opens a stack.
///
/// # Errors
/// If a page is damaged, pages differ in size or type, their kind is not read, or their spacing is stated nowhere.
pub(crate) fn open(path: &Path, options: &Options, limits: Limits) -> Result<Vec<Image>> {
    let files = files(path)?;
    let first = &files[0];
    let mut pages = Pages::open(first, limits).map_err(|e| e.at(first))?;
    let kind = pages.kind().map_err(|e| e.at(first))?;
    let own = pages.count().map_err(|e| e.at(first))?;
    let mut notes = Vec::new();
    let description = Description::parse(&pages.description(), pages.resolution());
    let (count, order) = if files.len() == 1 {
        (own, description.as_ref().map_or(Order::plain(own), |d| d.order(own)))
    } else {
        if own > 1 {
            notes.push(format!("only the first of {own} pages of each file was read"));
        }
        (files.len(), Order::plain(files.len()))
    };
    let order = order.filter_for(count).ok_or_else(|| {
        Error::unsupported(format!("{count} page(s), which its description divides in another way"))
            .hint("save the stack again, one page for each slice: in ImageJ as an ordinary TIFF, below 4 GiB")
            .at(first)
    })?;
    let index_to_world = place(description.as_ref(), order.slices, options, &mut notes).map_err(|e| e.at(path))?;
    let time = options.choose_time(order.times, &mut notes)?;
    if pages.is_inverted().map_err(|e| e.at(first))? {
        notes.push("displays show low values of these pages bright (MinIsWhite); values are kept as stored".into());
    }
    if order.channels > MOST_CHANNELS {
        return Err(Error::unsupported(format!("{} channels, at most {MOST_CHANNELS} are read", order.channels))
            .hint("save those that are wanted to a file of their own"));
    }
    let mut images = Vec::new();
    let name = |channel: usize| (order.channels > 1).then(|| format!("channel_{channel}"));
    for channel in (0..order.channels).filter(|c| name(*c).is_none_or(|n| options.wants(&n))) {
        let size = [kind.width, kind.height, order.slices];
        let values = if kind.integer { Values::Integer } else { Values::Real };
        let (components, notes) = (kind.components, std::mem::take(&mut notes));
        let header =
            Header { name: name(channel), size, components, values, index_to_world, about: About::default(), notes };
        let stack = Stack { files: files.clone(), limits, pages: None, kind, order, channel, time, z: 0 };
        images.push(Image { header, slices: Box::new(stack) });
    }
    let names: Vec<String> = (0..order.channels).filter_map(name).collect();
    if images.is_empty() { Err(options.no_array(&names)) } else { Ok(images) }
}

/// Map from indices to the world: what the caller states, else what the file does.
fn place(
    description: Option<&Description>,
    slices: usize,
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Affine> {
    if let Some(map) = options.placement()? {
        return Ok(map);
    }
    let stated = description.and_then(|d| d.spacing.map(|spacing| (spacing, d.depth, d.unit.as_str())));
    let Some(([x, y], depth, unit)) = stated else {
        return Err(Error::invalid("the stack does not say how large its voxels are")
            .hint("give ⟨voxel_size=EDGE⟩, or ⟨spacing=X,Y,Z⟩"));
    };
    let z = depth.unwrap_or(1.0);
    notes.push(if depth.is_some() || slices == 1 {
        format!("spacing {x} x {y} x {z} {unit}, as the file states")
    } else {
        format!(
            "spacing {x} x {y} {unit}, as the file states, which does not say how far slices are apart; 1 {unit} \
                 was taken"
        )
    });
    options.moved(&placement::affine([DVec3::X * x, DVec3::Y * y, DVec3::Z * z], DVec3::ZERO)?)
}

/// Slices of one channel.
struct Stack {
    files: Vec<PathBuf>,
    limits: Limits,
    /// Pages of the file that was read last, and its number.
    pages: Option<(usize, Pages)>,
    kind: Kind,
    order: Order,
    channel: usize,
    time: usize,
    z: usize,
}

impl Stack {
    fn slice(&mut self, file: usize, page: usize, values: &mut [f64]) -> Result<()> {
        if self.pages.as_ref().is_none_or(|(open, _)| *open != file) {
            self.pages = None;
            self.pages = Some((file, Pages::open(&self.files[file], self.limits)?));
        }
        let Some((_, pages)) = &mut self.pages else { return Ok(()) };
        pages.go_to(page)?;
        let kind = pages.kind()?;
        if kind != self.kind {
            return Err(Error::invalid(format!("slice {} has {kind}, the first one has {}", self.z, self.kind))
                .hint("leave out what does not belong to the stack, or save its slices alike"));
        }
        pages.read(values)
    }
}

impl Slices for Stack {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        let number = self.order.page(self.channel, self.z, self.time);
        let (file, page) = if self.files.len() > 1 { (number, 0) } else { (0, number) };
        let place = self.files[file].clone();
        self.slice(file, page, values).map_err(|e| e.at(place))?;
        self.z += 1;
        Ok(())
    }
}
