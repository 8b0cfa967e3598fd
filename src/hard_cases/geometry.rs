//! Rays, boxes, maps and values: faces that rays run along, places far from the origin, values that are no densities.

use super::fixtures::{MEMORY, field, grid, lumps, noise, rays, sheared, slanted, unit};
use super::{Area, Case, Formula, Naive, off, worse};
use crate::error::Result;
use crate::math::{Aabb, Affine, Ray};
use crate::render::dvr::Dvr;
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use glam::{DMat3, DMat4, DVec3, Mat3, Vec3};

pub(super) const CASES: &[Case] = &[
    Case {
        name: "slab-test",
        area: Area::Geometry,
        hazard: "length inside a box of rays parallel to an axis, on faces and along edges",
        remedy: "position alone decides where the direction is 0",
        naive_formula: "slab test by reciprocals: 0·∞",
        figure: "largest error of the length, relative to the box",
        bound: 1e-15,
        naive: Naive::Fails(1.0),
        measured: slab_test,
    },
    Case {
        name: "grazing-rays",
        area: Area::Geometry,
        hazard: "optical depth along faces, edges and corners of cells and bricks, and from inside",
        remedy: "cells and bricks counted in whole numbers",
        naive_formula: "cell by cell, pushed 1e-4 beyond each face",
        figure: "relative error of the optical depth",
        bound: 3e-7,
        naive: Naive::Fails(1e-5),
        measured: grazing_rays,
    },
    Case {
        name: "creeping-rays",
        area: Area::Geometry,
        hazard: "a ray of slope 1e-17 to 1e-12 on the face between two bricks, which rounds to either side",
        remedy: "cells and bricks counted in whole numbers",
        naive_formula: "cell by cell, pushed 1e-4 beyond each face",
        figure: "relative error of the optical depth",
        bound: 4e-7,
        naive: Naive::Fails(1.1e-5),
        measured: creeping_rays,
    },
    Case {
        name: "far-from-the-origin",
        area: Area::Geometry,
        hazard: "voxels of 1e-4 at 1e7, and of 1e7 at 1e12",
        remedy: "rays taken to index space in double precision, relative to the volume's origin",
        naive_formula: "world coordinates in single precision",
        figure: "error of the optical depth beyond the rounding of the ray's origin, relative to at least 0.1",
        bound: 1e-6,
        naive: Naive::Fails(0.1),
        measured: far_from_the_origin,
    },
    Case {
        name: "sheared-voxels",
        area: Area::Geometry,
        hazard: "optical depth through sheared, mirrored, non-uniform voxels",
        remedy: "lengths in world units along the ray",
        naive_formula: "lengths in index space times the mean edge of a voxel",
        figure: "error of the optical depth, relative to at least 0.1",
        bound: 8e-7,
        naive: Naive::Fails(1e-2),
        measured: sheared_voxels,
    },
    Case {
        name: "singular-maps",
        area: Area::Geometry,
        hazard: "flat and nearly flat voxels, tiny voxels, numbers that are none",
        remedy: "condition number of the scaled matrix, at most 1e12",
        naive_formula: "determinant in single precision, which must not be 0",
        figure: "maps judged wrongly",
        bound: 0.0,
        naive: Naive::Fails(2.0),
        measured: singular_maps,
    },
    Case {
        name: "empty-and-single-voxels",
        area: Area::Geometry,
        hazard: "a volume without voxels, and one voxel at the corner of a brick",
        remedy: "background passed through unchanged; bricks for every cell that a voxel reaches into",
        naive_formula: "slab test on the empty box; interpolation within the voxel's brick",
        figure: "largest error of pixels and optical depths",
        bound: 1e-7,
        naive: Naive::Fails(0.4),
        measured: empty_and_single_voxels,
    },
    Case {
        name: "poisoned-values",
        area: Area::Geometry,
        hazard: "NaN, infinities (which half precision makes of 65520), negative and giant densities in a grid",
        remedy: "refusal that names their number and the remedy",
        naive_formula: "least and greatest value compared with 0 and infinity",
        figure: "grids judged wrongly",
        bound: 0.0,
        naive: Naive::Fails(1.0),
        measured: poisoned_values,
    },
];

/// The slab test as it is usually written, with minima and maxima that return the second number if one is none.
fn naive_clip(bounds: &Aabb, ray: &Ray) -> Option<(f64, f64)> {
    let least = |a: f64, b: f64| if a < b { a } else { b };
    let most = |a: f64, b: f64| if a > b { a } else { b };
    let (mut near, mut far) = (0.0, f64::INFINITY);
    for a in 0..3 {
        let per = 1.0 / ray.direction[a];
        let (u, v) = ((bounds.min[a] - ray.origin[a]) * per, (bounds.max[a] - ray.origin[a]) * per);
        near = most(near, least(u, v));
        far = least(far, most(u, v));
    }
    (near < far).then_some((near, far))
}

fn slab_test(formula: Formula) -> Result<f64> {
    let bounds = Aabb { min: DVec3::new(-1.0, 2.0, 0.0), max: DVec3::new(3.0, 6.0, 4.0) };
    let mut most = 0.0;
    for axis in 0..3 {
        for place in 0..9 {
            for sign in [-1.0, 1.0] {
                // On both faces of the other axes, and in the middle of the box.
                let at = |k: i32| 0.5 * f64::from(k);
                let mut share = DVec3::ZERO;
                share[(axis + 1) % 3] = at(place % 3);
                share[(axis + 2) % 3] = at(place / 3);
                let mut ray = Ray::new(bounds.min + share * bounds.size(), DVec3::ZERO);
                ray.origin[axis] = bounds.centre()[axis] - 100.0 * sign;
                ray.direction[axis] = sign;
                let clip = match formula {
                    Formula::Cumulo => bounds.clip(&ray),
                    Formula::Naive => naive_clip(&bounds, &ray),
                };
                most = worse(most, clip.map_or(1.0, |(near, far)| ((far - near) / 4.0 - 1.0).abs()));
            }
        }
    }
    Ok(most)
}

/// Returns the optical depth along a ray from cell to cell, each of which is left by a small push.
fn pushed(field: &Bricks<f32>, ray: &Ray) -> f64 {
    const PUSH: f64 = 1e-4;
    let Some((mut t, leave)) = field.domain.clip(ray) else { return 0.0 };
    let mut depth = 0.0;
    while t < leave {
        let cell = ray.at(t + PUSH).floor();
        let mut next = leave;
        for a in 0..3 {
            let face = cell[a] + f64::from(u8::from(ray.direction[a] > 0.0));
            let at = (face - ray.origin[a]) / ray.direction[a];
            if at > t && at < next {
                next = at;
            }
        }
        let (middle, half) = (0.5 * (t + next), 0.5 * (next - t));
        let at = |node: f64| f64::from(field.sample(ray.at(middle + half * node)));
        // Gauss-Legendre, exact for the cubic that the density is.
        depth += half * (at(-(1.0_f64 / 3.0).sqrt()) + at((1.0_f64 / 3.0).sqrt()));
        t = next + PUSH;
    }
    depth
}

fn grazing_rays(formula: Formula) -> Result<f64> {
    let field: Bricks<f32> = field(32, unit()?, |_| 1.0)?;
    let dvr = Dvr::new(&field, Medium::absorbing(1.0))?.early_stop(0.0);
    let depth = |ray: &Ray| match formula {
        Formula::Cumulo => dvr.optical_depth(ray),
        Formula::Naive => pushed(&field, ray),
    };
    let mut most = 0.0;
    for axis in 0..3 {
        for (a, b) in [(8.0, 8.0), (8.0, 3.5), (0.0, 0.0), (15.0, 16.0), (31.0, 31.0), (3.0, 24.0)] {
            for sign in [-1.0, 1.0] {
                let mut ray = Ray::new(DVec3::ZERO, DVec3::ZERO);
                ray.origin[(axis + 1) % 3] = a;
                ray.origin[(axis + 2) % 3] = b;
                ray.direction[axis] = sign;
                ray.origin[axis] = 15.5 - 100.0 * sign;
                most = worse(most, off(depth(&ray), 32.0));
                // From the middle: half of it.
                ray.origin[axis] = 15.5;
                most = worse(most, off(depth(&ray), 16.0));
            }
        }
    }
    // Along space diagonals every cell is entered through a corner.
    for sign in [-1.0, 1.0] {
        let direction = DVec3::splat(sign / 3.0_f64.sqrt());
        let found = depth(&Ray::new(DVec3::splat(15.5) - 80.0 * direction, direction));
        // 31 cells of √3 at density 1 and the two cubic fall-offs ∫(1-t)³ √3 dt = √3/4 each.
        most = worse(most, off(found, 3.0_f64.sqrt() * 31.5));
    }
    // Tangent to the outer face of the fall-off: nothing.
    let outside = Ray::new(DVec3::new(-50.0, 32.0, 10.0), DVec3::X);
    Ok(if depth(&outside) == 0.0 { most } else { f64::INFINITY })
}

fn creeping_rays(formula: Formula) -> Result<f64> {
    let field: Bricks<f32> = field(32, unit()?, |p| 1.0 + 0.1 * p.x)?;
    let dvr = Dvr::new(&field, Medium::absorbing(1.0))?.early_stop(0.0);
    let mut most = 0.0;
    for slope in [6e-17, -6e-17, 1e-12, -1e-12, 0.0] {
        for x in [8.0, 8.0 + 2e-15, 8.0 - 2e-15, 16.0, 16.0 - 4e-15] {
            let ray = Ray::new(DVec3::new(x, -40.0, 9.5), DVec3::new(slope, 1.0, 0.0));
            let found = match formula {
                Formula::Cumulo => dvr.optical_depth(&ray),
                Formula::Naive => pushed(&field, &ray),
            };
            most = worse(most, off(found, 32.0 * (1.0 + 0.1 * x)));
        }
    }
    Ok(most)
}

/// Returns the optical depth by samples a quarter of a voxel apart, in single precision.
fn single_precision(field: &Bricks<f32>, ray: &Ray, size: f64) -> f64 {
    let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
    let corner = field.transform.to_world(DVec3::ZERO).as_vec3();
    let (step, reach) = (0.25 * size as f32, 4 * 6 * 24);
    let sample = |k: i32| {
        let at: Vec3 = origin + (k as f32 + 0.5) * step * direction;
        field.sample(((at - corner) / size as f32).as_dvec3())
    };
    f64::from(0.25 * (0..reach).map(sample).sum::<f32>())
}

fn far_from_the_origin(formula: Formula) -> Result<f64> {
    let near: Bricks<f64> = field(24, unit()?, lumps(24))?;
    let reference = Dvr::new(&near, Medium::absorbing(1.0))?;
    let places = [
        (1e-4, DVec3::new(1e3, -2e3, 5e2)),
        (1.0, DVec3::splat(1e7)),
        (1e7, DVec3::splat(-1e12)),
        (1e-4, DVec3::splat(1e7)),
    ];
    let mut most = 0.0;
    for (size, at) in places {
        let transform = Affine::uniform(size, at)?;
        let far: Bricks<f32> = field(24, transform, lumps(24))?;
        let dvr = Dvr::new(&far, Medium::absorbing(1.0 / size))?;
        // The ray's own origin is rounded to 2^-52 of where it is: 2e-5 voxels at 1e7, whose densities change by up to
        // their own size from voxel to voxel.
        let rounding = 2.0 * 2.0_f64.powi(-52) * at.abs().max_element() / size;
        for ray in rays(near.world_bounds(), 60, 31) {
            let world = Ray::new(transform.to_world(ray.origin), ray.direction);
            let found = match formula {
                Formula::Cumulo => dvr.optical_depth(&world),
                Formula::Naive => single_precision(&far, &world, size),
            };
            let expected = reference.optical_depth(&ray);
            most = worse(most, (found - expected).abs() / expected.max(0.1) - rounding);
        }
    }
    Ok(most)
}

fn sheared_voxels(formula: Formula) -> Result<f64> {
    let map = sheared()?;
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(24, map, lumps(24))?, field(24, map, lumps(24))?);
    let (narrow, straight) = (Dvr::new(&narrow, Medium::absorbing(1.0))?, field::<f64>(24, unit()?, lumps(24))?);
    let (wide, straight) = (Dvr::new(&wide, Medium::absorbing(1.0))?, Dvr::new(&straight, Medium::absorbing(1.0))?);
    let rays = rays(wide.field().world_bounds(), 60, 31);
    let errors = rays.iter().map(|ray| {
        let found = match formula {
            Formula::Cumulo => narrow.optical_depth(ray),
            Formula::Naive => {
                let (origin, direction) = (map.to_index(ray.origin), map.vector_to_index(ray.direction).normalize());
                map.voxel_size().element_sum() / 3.0 * straight.optical_depth(&Ray::new(origin, direction))
            }
        };
        let expected = wide.optical_depth(ray);
        (found - expected).abs() / expected.max(0.1)
    });
    Ok(errors.fold(0.0, worse))
}

fn singular_maps(formula: Formula) -> Result<f64> {
    let flat = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0));
    let nearly = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 1e-13));
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 2.0, 0.5));
    let all = [
        (flat, true),
        (nearly, true),
        (1e-30 * nearly, true),
        (DMat3::ZERO, true),
        (f64::NAN * DMat3::IDENTITY, true),
        (f64::INFINITY * DMat3::IDENTITY, true),
        (1e-30 * DMat3::IDENTITY, false),
        (1e30 * DMat3::IDENTITY, false),
        (1e-20 * mirrored, false),
    ];
    let wrong = all.into_iter().filter(|(linear, singular)| {
        let refused = match formula {
            Formula::Cumulo => match Affine::new(DMat4::from_mat3(*linear)) {
                Ok(_) => false,
                // A singular map must be refused with its condition number.
                Err(error) => !linear.is_finite() || error.to_string().contains("condition number"),
            },
            Formula::Naive => Mat3::from_cols_array(&linear.to_cols_array().map(|v| v as f32)).determinant() == 0.0,
        };
        refused != *singular
    });
    Ok(wrong.count() as f64)
}

fn empty_and_single_voxels(formula: Formula) -> Result<f64> {
    let empty: Bricks<f32> = field(8, unit()?, |_| 0.0)?;
    let mut most: f64 = if empty.topology.is_empty() { 0.0 } else { f64::INFINITY };
    // Along an axis, and along none, where the empty box's slabs are all crossed.
    for ray in [Ray::new(DVec3::new(-5.0, 4.0, 4.0), DVec3::X), slanted()] {
        most = match formula {
            Formula::Cumulo => {
                let seen = Dvr::new(&empty, Medium::absorbing(1.0))?.over([1.0; 3]).pixel(&ray);
                let [r, g, b, alpha] = seen.rgba().map(f64::from);
                // Exactly.
                if [r, g, b, alpha] == [1.0, 1.0, 1.0, 0.0] { most } else { f64::INFINITY }
            }
            // The background is seen only where the box is missed.
            Formula::Naive => worse(most, f64::from(u8::from(naive_clip(&Aabb::EMPTY, &ray).is_some()))),
        };
    }
    // One voxel at the low corner of a leaf: it reaches into bricks that have no leaf. It is a hat of height and
    // half-width one.
    let single: Bricks<f32> = field(9, unit()?, |p| f64::from(p == DVec3::splat(8.0)))?;
    let dvr = Dvr::new(&single, Medium::absorbing(1.0))?;
    for direction in [DVec3::X, DVec3::Y, DVec3::NEG_Z] {
        let depth = match formula {
            Formula::Cumulo => dvr.optical_depth(&Ray::new(DVec3::splat(8.0) - 20.0 * direction, direction)),
            Formula::Naive => {
                let within = |k: i32| 8.0 + 0.01 * (f64::from(k) + 0.5);
                let at = |k: i32| single.sample(DVec3::splat(8.0) + (within(k) - 8.0) * direction.abs());
                0.01 * (0..100).map(|k| f64::from(at(k))).sum::<f64>()
            }
        };
        most = worse(most, (depth - 1.0).abs());
    }
    Ok(most)
}

fn poisoned_values(formula: Formula) -> Result<f64> {
    let values = [
        (f64::NAN, true),
        (f64::INFINITY, true),
        (f64::NEG_INFINITY, true),
        (-1.0, true),
        (1e35, true),
        (1e30, false),
        (65504.0, false),
    ];
    let mut wrong = 0;
    for (value, poisoned) in values {
        let grid = grid(8, unit()?, |p| if p == DVec3::ZERO { value } else { noise(p.x as u64) });
        let refused = match formula {
            Formula::Cumulo => match Bricks::<f32>::from_grid(&grid, MEMORY) {
                Ok(_) => false,
                Err(error) if value == 1e35 => error.to_string().contains("densities reach 1e35"),
                Err(error) => {
                    // The remedy is worded as the process's face words settings.
                    let text = error.to_string();
                    text.contains("1 values are") && text.contains("repair")
                }
            },
            Formula::Naive => {
                let all = grid.leaves.iter().flat_map(|leaf| leaf.values.iter());
                let (low, high) = all.fold((0.0_f32, 0.0_f32), |(low, high), v| (low.min(*v), high.max(*v)));
                low < 0.0 || high.is_infinite()
            }
        };
        wrong += u32::from(refused != poisoned);
    }
    Ok(f64::from(wrong))
}
