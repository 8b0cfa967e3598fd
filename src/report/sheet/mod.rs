//! Contact sheets: pictures with titles and captions below a heading, as one picture.

mod canvas;
mod font;
mod frame;
mod histogram;
mod plan;
mod raster;

pub(crate) use canvas::{Canvas, Color};
pub(crate) use font::Font;
pub(crate) use frame::with_axes;
pub(crate) use histogram::Histogram;
pub(crate) use plan::{Stand, plan};
pub(crate) use raster::{Range, fitted, grey, signed};

/// Colors of a sheet: paper, text, and text of less weight.
const PAPER: Color = [250, 250, 248];
const INK: Color = [28, 30, 34];
const PALE: Color = [96, 100, 108];
const BORDER: Color = [224, 224, 221];

/// Space around the sheet, and between its pictures, in pixels.
const MARGIN: usize = 16;

/// Least width of a sheet, so that its heading need not wrap much.
const LEAST_WIDTH: usize = 480;

/// Largest side of a sheet in pixels; what lies beyond is cut.
const MOST_SIDE: usize = 16_384;

/// A picture of a sheet, with its words.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    /// Line above the picture.
    pub title: String,
    /// Picture.
    pub picture: Canvas,
    /// Lines below the picture.
    pub caption: Vec<String>,
}

/// A contact sheet.
#[derive(Debug, Clone)]
pub(crate) struct Sheet {
    /// Heading in large letters.
    pub title: String,
    /// Lines below the heading.
    pub lines: Vec<String>,
    /// Picture to the left of all others.
    pub lead: Option<Tile>,
    /// Pictures, from left to right and from the top down.
    pub tiles: Vec<Tile>,
    /// Most pictures side by side.
    pub columns: usize,
}

impl Sheet {
    /// Number of pictures side by side that makes a sheet of `count` equal pictures about half as wide again as high.
    pub(crate) fn columns_of(count: usize) -> usize {
        ((1.5 * count as f64).sqrt().ceil() as usize).clamp(1, 12)
    }

    /// Draws the sheet.
    pub(crate) fn draw(&self) -> Canvas {
        let lead = self.lead.as_ref().map(Block::of);
        let rows: Vec<Vec<Block>> =
            self.tiles.chunks(self.columns.max(1)).map(|row| row.iter().map(Block::of).collect()).collect();
        let row_width = |row: &Vec<Block>| row.iter().map(|b| b.width + MARGIN).sum::<usize>();
        let row_height = |row: &Vec<Block>| row.iter().map(|b| b.height + MARGIN).fold(0, usize::max);
        let left = lead.as_ref().map_or(MARGIN, |b| b.width + 2 * MARGIN);
        let width = (left + rows.iter().map(row_width).fold(0, usize::max)).clamp(LEAST_WIDTH, MOST_SIDE);
        let heading = self.heading(width - 2 * MARGIN);
        let top = 2 * MARGIN + heading.iter().map(|(_, font, _)| font.size()[1]).sum::<usize>();
        let below = rows.iter().map(row_height).sum::<usize>().max(lead.as_ref().map_or(0, |b| b.height + MARGIN));
        let mut canvas = Canvas::new(width, (top + below).min(MOST_SIDE), PAPER);
        let mut y = MARGIN;
        for (line, font, color) in &heading {
            canvas.text([MARGIN, y], line, *font, *color);
            y += font.size()[1];
        }
        if let Some(block) = &lead {
            block.draw(&mut canvas, [MARGIN, top]);
        }
        let mut y = top;
        for row in &rows {
            let mut x = left;
            for block in row {
                block.draw(&mut canvas, [x, y]);
                x += block.width + MARGIN;
            }
            y += row_height(row);
        }
        canvas
    }

    /// Lines above the pictures, with their fonts and colors.
    fn heading(&self, width: usize) -> Vec<(String, Font, Color)> {
        let title = font::wrapped(&self.title, Font::Large.fitting(width));
        let lines = self.lines.iter().flat_map(|line| font::wrapped(line, Font::Small.fitting(width)));
        let title = title.into_iter().map(|line| (line, Font::Large, INK));
        title.chain(lines.map(|line| (line, Font::Small, PALE))).collect()
    }
}

/// A tile with its words in lines.
struct Block<'t> {
    tile: &'t Tile,
    title: Vec<String>,
    caption: Vec<String>,
    width: usize,
    height: usize,
}

/// Least width of a tile: words below a small picture need some.
const LEAST_TILE: usize = 112;

impl<'t> Block<'t> {
    fn of(tile: &'t Tile) -> Self {
        let width = tile.picture.width.max(LEAST_TILE);
        let most = Font::Small.fitting(width);
        let title = font::wrapped(&tile.title, most);
        let caption: Vec<String> = tile.caption.iter().flat_map(|line| font::wrapped(line, most)).collect();
        let lines = title.len() + caption.len();
        let height = tile.picture.height + lines * Font::Small.size()[1] + 4;
        Self { tile, title, caption, width, height }
    }

    fn draw(&self, canvas: &mut Canvas, [x, mut y]: [usize; 2]) {
        let line_height = Font::Small.size()[1];
        for line in &self.title {
            canvas.text([x, y], line, Font::Small, INK);
            y += line_height;
        }
        let Canvas { width, height, .. } = self.tile.picture;
        // A thin line around the picture tells white from paper.
        canvas.fill([x - 1, y + 1], [width + 2, height + 2], BORDER);
        canvas.put(&self.tile.picture, [x, y + 2]);
        y += self.tile.picture.height + 4;
        for line in &self.caption {
            canvas.text([x, y], line, Font::Small, PALE);
            y += line_height;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(width: usize, height: usize) -> Tile {
        Tile {
            title: "view 3".into(),
            picture: Canvas::new(width, height, [1, 2, 3]),
            caption: vec!["a caption that is longer than its picture is wide".into()],
        }
    }

    #[test]
    fn every_picture_is_whole_and_apart_from_the_others() {
        let sizes = [(200, 100), (30, 60), (120, 10), (64, 64), (1, 1)];
        let sheet = Sheet {
            title: "smoke.vdb".into(),
            lines: vec!["grid 'density'".into()],
            lead: Some(tile(50, 400)),
            tiles: sizes.iter().map(|(w, h)| tile(*w, *h)).collect(),
            columns: 2,
        };
        let canvas = sheet.draw();
        let pixels = canvas.rgb.chunks(3).filter(|p| *p == [1, 2, 3]).count();
        assert_eq!(pixels, 50 * 400 + sizes.iter().map(|(w, h)| w * h).sum::<usize>());
        // Nothing touches the border.
        let border = |p: Color| assert_eq!(p, PAPER);
        (0..canvas.width)
            .for_each(|x| [0, canvas.height - 1].map(|y| border(canvas.pixel(x, y))).into_iter().collect());
        (0..canvas.height)
            .for_each(|y| [0, canvas.width - 1].map(|x| border(canvas.pixel(x, y))).into_iter().collect());
    }

    #[test]
    fn an_empty_sheet_has_its_heading() {
        let canvas = Sheet { title: "a".into(), lines: vec![], lead: None, tiles: vec![], columns: 0 }.draw();
        assert!(canvas.rgb.chunks(3).any(|p| p == INK));
        assert_eq!([1, 6, 24, 10_000].map(Sheet::columns_of), [2, 3, 6, 12]);
    }
}
