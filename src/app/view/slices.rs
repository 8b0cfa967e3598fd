//! Slices through the middle of a grid of any type, read leaf by leaf.

use crate::error::Result;
use crate::formats::vdb::{GridInfo, NativeGrid};
use crate::math::Affine;
use crate::scene::film::Film;
use crate::scene::up::Up;
use glam::{DMat3, DMat4};
use serde::Serialize;

/// Names of the index axes.
pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

/// Names of index axes that run against the world's.
const REVERSED: [&str; 3] = ["-x", "-y", "-z"];

/// How the index axes lie in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Orientation {
    /// Index axis that is nearest to the vertical.
    up: usize,
    /// For each index axis, true if it runs against the axis of the world that it is nearest to.
    reversed: [bool; 3],
}

impl Orientation {
    /// Orientation by a transform to a world with an upward axis; without a transform the index axes count as the
    /// world's.
    pub(super) fn of(transform: Option<&Affine>, up: Up) -> Self {
        let matrix = DMat3::from_mat4(transform.map_or(DMat4::IDENTITY, Affine::matrix));
        let columns = [0, 1, 2].map(|a| matrix.col(a).normalize_or_zero());
        let height = |a: &usize| columns[*a].dot(up.vector()).abs();
        Self {
            up: (0..3).max_by(|a, b| height(a).total_cmp(&height(b))).unwrap_or(2),
            reversed: columns.map(|column| column[column.abs().max_position()] < 0.0),
        }
    }

    /// Normal of each slice, and the axes to the right and up in it: the vertical axis, and else the later one, is up.
    fn cuts(self) -> [[usize; 3]; 3] {
        [[2, 0, 1], [1, 0, 2], [0, 1, 2]].map(
            |[normal, right, up]| {
                if right == self.up { [normal, up, right] } else { [normal, right, up] }
            },
        )
    }
}

/// Place of a slice.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
pub(super) struct Cut {
    /// Axis that is perpendicular to it.
    pub axis: &'static str,
    /// Index along the axis.
    pub index: i32,
    /// Axis to the right; one that runs against the world's points to the left, and has a minus sign here.
    pub right: &'static str,
    /// Axis up, with the sign of `right`.
    pub up: &'static str,
}

/// A slice.
pub(super) struct Slice {
    pub cut: Cut,
    /// Means of values over square blocks of voxels, as grey pixels.
    pub film: Film,
    /// Width and height in world units.
    pub extent: [f64; 2],
}

/// Length of a vector; the value itself of a scalar.
pub(super) fn magnitude(value: &[f32]) -> f32 {
    match value {
        [one] => *one,
        many => many.iter().map(|c| c * c).sum::<f32>().sqrt(),
    }
}

/// Value of a slice where the grid has neither voxels nor tiles.
pub(super) fn background(info: &GridInfo) -> f32 {
    let values: Vec<f32> = info.background.iter().take(info.components).map(|v| *v as f32).collect();
    magnitude(&values)
}

/// Returns the slices through the middle of the box of active voxels, whose longer side has at most `side` pixels; none
/// of an empty grid. Directions of the world to the right and up are those in the slice.
///
/// # Errors
/// If the grid has no values.
pub(super) fn central(
    native: &NativeGrid,
    info: &GridInfo,
    voxel: [f64; 3],
    orientation: Orientation,
    side: usize,
) -> Result<Vec<Slice>> {
    let Some(bounds) = info.index_box else { return Ok(Vec::new()) };
    let background = background(info);
    let mut rasters = orientation.cuts().map(|axes| Raster::new(axes, bounds, background, side));
    native.for_each_leaf(|leaf| {
        for raster in &mut rasters {
            raster.leaf(leaf.origin, &leaf.values, info.components);
        }
        true
    })?;
    for tile in native.tiles()? {
        for raster in &mut rasters {
            raster.block(tile.origin, tile.dim, magnitude(&tile.value[..info.components]));
        }
    }
    Ok(rasters.into_iter().map(|raster| raster.finish(voxel, orientation.reversed)).collect())
}

/// A slice that is being filled.
struct Raster {
    axes: [usize; 3],
    low: [i32; 3],
    high: [i32; 3],
    index: i32,
    background: f32,
    /// Voxels along the edge of a pixel.
    block: i64,
    width: usize,
    height: usize,
    /// Sums of the differences from the background.
    sums: Vec<f64>,
}

impl Raster {
    fn new(axes: [usize; 3], (low, high): ([i32; 3], [i32; 3]), background: f32, side: usize) -> Self {
        let [normal, right, up] = axes;
        let extent = |a: usize| i64::from(high[a]) - i64::from(low[a]) + 1;
        let block = (extent(right).max(extent(up)) as u64).div_ceil(side.max(1) as u64).max(1) as i64;
        let pixels = |a: usize| (extent(a) as u64).div_ceil(block as u64) as usize;
        let (width, height) = (pixels(right), pixels(up));
        let index = ((i64::from(low[normal]) + i64::from(high[normal])).div_euclid(2)) as i32;
        Self { axes, low, high, index, background, block, width, height, sums: vec![0.0; width * height] }
    }

    /// Column or row, counted from the lower end of an axis, of an index within the box.
    fn pixel(&self, axis: usize, index: i32) -> usize {
        ((i64::from(index) - i64::from(self.low[axis])) / self.block) as usize
    }

    fn holds(&self, axis: usize, index: i32) -> bool {
        (self.low[axis]..=self.high[axis]).contains(&index)
    }

    fn leaf(&mut self, origin: [i32; 3], values: &[f32], components: usize) {
        let [normal, right, up] = self.axes;
        let depth = i64::from(self.index) - i64::from(origin[normal]);
        if !(0..8).contains(&depth) {
            return;
        }
        for (r, u) in (0..8).flat_map(|u| (0..8).map(move |r| (r, u))) {
            let [x, y] = [origin[right].saturating_add(r), origin[up].saturating_add(u)];
            if self.holds(right, x) && self.holds(up, y) {
                let mut place = [0; 3];
                (place[normal], place[right], place[up]) = (depth as usize, r as usize, u as usize);
                let at = components * (place[0] << 6 | place[1] << 3 | place[2]);
                let value = magnitude(&values[at..at + components]);
                let to = self.pixel(up, y) * self.width + self.pixel(right, x);
                self.sums[to] += f64::from(value) - f64::from(self.background);
            }
        }
    }

    /// Fills what lies in a cube of one value.
    fn block(&mut self, origin: [i32; 3], dim: i32, value: f32) {
        let [normal, right, up] = self.axes;
        let ends = |a: usize| (i64::from(origin[a]), i64::from(origin[a]) + i64::from(dim));
        let (near, far) = ends(normal);
        if !(near..far).contains(&i64::from(self.index)) {
            return;
        }
        let clipped = |a: usize| {
            let (from, to) = ends(a);
            (from.max(i64::from(self.low[a])), to.min(i64::from(self.high[a]) + 1))
        };
        let ((x0, x1), (y0, y1)) = (clipped(right), clipped(up));
        if x0 >= x1 || y0 >= y1 {
            return;
        }
        let covered = |axis: usize, pixel: usize, (from, to): (i64, i64)| {
            let start = i64::from(self.low[axis]) + pixel as i64 * self.block;
            (to.min(start + self.block) - from.max(start)) as f64
        };
        let columns = self.pixel(right, x0 as i32)..=self.pixel(right, (x1 - 1) as i32);
        let rows = self.pixel(up, y0 as i32)..=self.pixel(up, (y1 - 1) as i32);
        let by = f64::from(value) - f64::from(self.background);
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let voxels = covered(right, column, (x0, x1)) * covered(up, row, (y0, y1));
            self.sums[row * self.width + column] += by * voxels;
        }
    }

    fn finish(self, voxel: [f64; 3], reversed: [bool; 3]) -> Slice {
        let [normal, right, up] = self.axes;
        let extent = |a: usize| (i64::from(self.high[a]) - i64::from(self.low[a]) + 1) as f64;
        let inside =
            |a: usize, pixel: usize| (self.block as f64).min(extent(a) - pixel as f64 * self.block as f64).max(1.0);
        // Row 0 of a picture is its top.
        let pixel = |i: usize| {
            let (mut row, mut column) = (i / self.width, i % self.width);
            if !reversed[up] {
                row = self.height - 1 - row;
            }
            if reversed[right] {
                column = self.width - 1 - column;
            }
            let voxels = inside(right, column) * inside(up, row);
            let value = f64::from(self.background) + self.sums[row * self.width + column] / voxels;
            [value as f32; 4]
        };
        let film = Film::of(self.width, self.height, (0..self.width * self.height).map(pixel).collect());
        let name = |a: usize| if reversed[a] { REVERSED[a] } else { AXES[a] };
        let cut = Cut { axis: AXES[normal], index: self.index, right: name(right), up: name(up) };
        Slice { cut, film, extent: [extent(right) * voxel[right], extent(up) * voxel[up]] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn cubes_and_leaves_fill_the_same_pixels() {
        // A box of 20 x 11 x 16 voxels at an odd place, in pixels of 2 voxels.
        let bounds = ([-3, 5, 0], [16, 15, 15]);
        for axes in Orientation::of(None, Up::Z).cuts() {
            let mut by_leaf = Raster::new(axes, bounds, 0.5, 10);
            let mut by_tile = Raster::new(axes, bounds, 0.5, 10);
            for origin in [[-8, 8, 0], [0, 0, 8], [0, 8, 8], [16, 8, 8]] {
                by_leaf.leaf(origin, &[2.5; 512], 1);
                by_tile.block(origin, 8, 2.5);
            }
            assert_eq!(by_leaf.sums, by_tile.sums, "{axes:?}");
            let slice = by_tile.finish([1.0, 1.0, 2.0], [false; 3]);
            let means: Vec<f32> = slice.film.rgba.iter().map(|p| p[0]).collect();
            assert!(means.contains(&2.5) && means.iter().all(|v| (0.5..=2.5).contains(v)), "{means:?}");
        }
    }

    #[test]
    fn slices_are_upright() {
        // The cube lies at the low end of x and at the high end of y: top left in the slice along z.
        let corners = |reversed: [bool; 3]| {
            let mut raster = Raster::new([2, 0, 1], ([0; 3], [15; 3]), 0.0, 16);
            raster.block([0, 8, 0], 8, 1.0);
            let slice = raster.finish([1.0; 3], reversed);
            let corner = |i: usize| slice.film.rgba[i][0];
            ([corner(0), corner(15), corner(16 * 15), corner(16 * 15 + 15)], [slice.cut.right, slice.cut.up])
        };
        assert_eq!(corners([false; 3]), ([1.0, 0.0, 0.0, 0.0], ["x", "y"]));
        assert_eq!(corners([true, false, true]), ([0.0, 1.0, 0.0, 0.0], ["-x", "y"]));
        assert_eq!(corners([false, true, true]), ([0.0, 0.0, 1.0, 0.0], ["x", "-y"]));
    }

    #[test]
    fn the_vertical_of_the_world_is_up() {
        let of =
            |map: &Affine, up: Up| (Orientation::of(Some(map), up).cuts(), Orientation::of(Some(map), up).reversed);
        let straight = Affine::uniform(0.1, DVec3::ONE).unwrap();
        assert_eq!(of(&straight, Up::Z), ([[2, 0, 1], [1, 0, 2], [0, 1, 2]], [false; 3]));
        assert_eq!(of(&straight, Up::Y), ([[2, 0, 1], [1, 0, 2], [0, 2, 1]], [false; 3]));
        // The same grid turned into the other world is seen as before.
        let turned = straight.then(&Affine::new(Up::Y.turn_map(Up::Z)).unwrap()).unwrap();
        assert_eq!(of(&turned, Up::Z), ([[2, 0, 1], [1, 0, 2], [0, 2, 1]], [false, false, true]));
        let mirrored = Affine::new(DMat4::from_scale(DVec3::new(-2.0, 1.0, -3.0))).unwrap();
        assert_eq!(of(&mirrored, Up::Z), ([[2, 0, 1], [1, 0, 2], [0, 1, 2]], [true, false, true]));
    }

    #[test]
    fn giant_boxes_take_no_more_pixels() {
        let mut raster = Raster::new([1, 0, 2], ([i32::MIN; 3], [i32::MAX; 3]), 0.0, 32);
        raster.block([i32::MIN; 3], i32::MAX, 1.0);
        raster.leaf([i32::MAX - 7; 3], &[1.0; 512], 1);
        assert_eq!((raster.width, raster.height), (32, 32));
        assert!(raster.finish([1.0; 3], [false; 3]).film.rgba.iter().all(|p| p[0].is_finite()));
    }
}
