//! What ImageJ and OME say of a stack in the description of its first page.

use quick_xml::Reader;
use quick_xml::events::Event;

/// Order of a stack's pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Order {
    /// Number of slices.
    pub slices: usize,
    /// Number of channels.
    pub channels: usize,
    /// Number of points in time.
    pub times: usize,
    /// Axes from the fastest to the slowest: channel `C`, slice `Z`, time `T`.
    axes: [u8; 3],
}

impl Order {
    /// Slices alone.
    pub(crate) fn plain(slices: usize) -> Self {
        Self { slices, channels: 1, times: 1, axes: *b"CZT" }
    }

    /// This order, if its pages are as many as there are.
    pub(crate) fn filter_for(self, pages: usize) -> Option<Self> {
        let count = self.slices.checked_mul(self.channels).and_then(|n| n.checked_mul(self.times));
        (count == Some(pages)).then_some(self)
    }

    /// Number of a page.
    pub(crate) fn page(&self, channel: usize, slice: usize, time: usize) -> usize {
        let (mut page, mut step) = (0, 1);
        for axis in self.axes {
            let (at, length) = match axis {
                b'C' => (channel, self.channels),
                b'Z' => (slice, self.slices),
                _ => (time, self.times),
            };
            page += at * step;
            step *= length;
        }
        page
    }
}

/// Spacing, unit and order of pages.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Description {
    /// Distances of neighboring columns and rows, if they are stated.
    pub spacing: Option<[f64; 2]>,
    /// Distance of neighboring slices, if it is stated.
    pub depth: Option<f64>,
    /// Unit of these distances.
    pub unit: String,
    counts: [Option<usize>; 3],
    axes: [u8; 3],
}

/// Length of a unit of OME in meters; none for units that are no length, such as pixels.
fn meters(unit: &str) -> Option<f64> {
    Some(match unit {
        "pm" => 1e-12,
        "Å" => 1e-10,
        "nm" => 1e-9,
        // The micro sign and the Greek letter.
        "\u{b5}m" | "\u{3bc}m" => 1e-6,
        "mm" => 1e-3,
        "cm" => 1e-2,
        "m" => 1.0,
        "in" => 0.0254,
        _ => return None,
    })
}

impl Description {
    /// Reads a description; `resolution` is that of the page, in pixels per unit along x and y.
    pub(crate) fn parse(text: &str, resolution: Option<[f64; 2]>) -> Option<Self> {
        if text.starts_with("ImageJ=") {
            return Some(Self::image_j(text, resolution));
        }
        let ome = text.trim_start().starts_with('<') && text.contains("<Pixels") || text.contains(":Pixels");
        if ome { Self::ome(text) } else { None }
    }

    fn image_j(text: &str, resolution: Option<[f64; 2]>) -> Self {
        let get = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('=')).map(str::trim);
        let count = |key| get(key).and_then(|v| v.parse().ok()).filter(|n: &usize| *n > 0);
        let unit = get("unit").map(|u| u.replace("\\u00B5", "µ")).filter(|u| !u.is_empty() && u != "pixel");
        let pixel = resolution.filter(|r| r.iter().all(|r| r.is_finite() && *r > 0.0)).map(|[x, y]| [1.0 / x, 1.0 / y]);
        let depth =
            get("spacing").and_then(|v| v.parse().ok()).filter(|d: &f64| d.is_finite() && *d != 0.0).map(f64::abs);
        // Without a unit the numbers are pixels.
        let spacing = pixel.filter(|_| unit.is_some() || depth.is_some());
        let (channels, frames) = (count("channels"), count("frames"));
        // Of large stacks ImageJ writes one directory for all images.
        let volumes = channels.unwrap_or(1).saturating_mul(frames.unwrap_or(1));
        let slices = count("slices").or_else(|| count("images").map(|images| images / volumes));
        let unit = unit.unwrap_or_else(|| "pixel".into());
        Self { spacing, depth, unit, counts: [channels, slices, frames], axes: *b"CZT" }
    }

    fn ome(text: &str) -> Option<Self> {
        let mut reader = Reader::from_str(text);
        let pixels = loop {
            match reader.read_event().ok()? {
                Event::Start(e) | Event::Empty(e) if e.local_name().as_ref() == "Pixels" => break e.into_owned(),
                Event::Eof => return None,
                _ => {}
            }
        };
        let get = |key: &str| {
            let value = pixels.try_get_attribute(key).ok()??;
            Some(value.value.into_owned())
        };
        let number = |key: &str| get(key).and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite() && *v > 0.0);
        let count = |key| get(key).and_then(|v| v.parse().ok()).filter(|n: &usize| *n > 0);
        let unit = |axis: char| get(&format!("PhysicalSize{axis}Unit"));
        let first = unit('X').unwrap_or_else(|| "µm".into());
        // Distance in the unit of x, which writers mean for the other axes, too, where they leave it out; none if the
        // units cannot be compared.
        let size = |axis: char| {
            let (size, own) = (number(&format!("PhysicalSize{axis}"))?, unit(axis));
            match own.filter(|own| *own != first) {
                Some(own) => Some(size * (meters(&own)? / meters(&first)?)),
                None => Some(size),
            }
        };
        let spacing = size('X').zip(size('Y')).map(|(x, y)| [x, y]);
        let order = get("DimensionOrder").unwrap_or_default();
        let axes = order.strip_prefix("XY").and_then(|o| <[u8; 3]>::try_from(o.as_bytes()).ok()).unwrap_or(*b"CZT");
        let depth = size('Z');
        Some(Self { spacing, depth, unit: first, counts: [count("SizeC"), count("SizeZ"), count("SizeT")], axes })
    }

    /// Order of a file's pages, of which there are so many.
    pub(crate) fn order(&self, pages: usize) -> Order {
        let [channels, slices, times] = self.counts;
        let (channels, times) = (channels.unwrap_or(1), times.unwrap_or(1));
        let others = channels.saturating_mul(times).max(1);
        // ImageJ leaves out the number of slices of plain stacks. Colors that lie in one page count as channels in OME.
        let slices = slices.unwrap_or(pages / others);
        let order = Order { slices, channels, times, axes: self.axes };
        let in_page = Order { channels: 1, ..order };
        if order.filter_for(pages).is_none() && in_page.filter_for(pages).is_some() { in_page } else { order }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn descriptions_state_spacing_and_order() {
        let text = "ImageJ=1.53c\nimages=12\nchannels=2\nslices=3\nframes=2\nunit=micron\nspacing=0.5\n";
        let d = Description::parse(text, Some([4.0, 2.0])).unwrap();
        assert_eq!((d.spacing, d.depth, d.unit.as_str()), (Some([0.25, 0.5]), Some(0.5), "micron"));
        let order = d.order(12);
        assert_eq!((order.slices, order.channels, order.times, order.page(1, 2, 1)), (3, 2, 2, 1 + 2 * 2 + 6));
        assert!(order.filter_for(1).is_none());
        let text = r#"<?xml version="1.0"?><OME xmlns="x"><Image><Pixels DimensionOrder="XYZTC" SizeC="2" SizeT="1"
            SizeZ="4"
            PhysicalSizeX="0.1" PhysicalSizeY="0.2" PhysicalSizeZ="0.3" PhysicalSizeXUnit="nm"/></Image></OME>"#;
        let d = Description::parse(text, None).unwrap();
        assert_eq!((d.spacing, d.depth, d.unit.as_str()), (Some([0.1, 0.2]), Some(0.3), "nm"));
        let in_unit = |unit| {
            let text = text.replace("PhysicalSizeZ=", &format!("PhysicalSizeZUnit=\"{unit}\" PhysicalSizeZ="));
            Description::parse(&text, None).unwrap().depth
        };
        assert_eq!((in_unit("nm"), in_unit("pixel")), (Some(0.3), None));
        // A quotient and a product round once each.
        assert!((in_unit("µm").unwrap() - 300.0).abs() < 300.0 * 2.0 * f64::EPSILON);
        assert_eq!(d.order(8).page(1, 3, 0), 7);
        assert_eq!(Description::parse("a picture", None), None);
        let d = Description::parse("ImageJ=1\nimages=12\n", Some([1.0, 1.0])).unwrap();
        assert!(d.spacing.is_none() && d.order(1).filter_for(1).is_none() && d.order(12).filter_for(12).is_some());
    }
}
