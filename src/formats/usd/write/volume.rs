//! Volumes as prims of UsdVol, one field for each grid.

use super::light::placed;
use super::material::{self, Renderer};
use super::medium;
use super::names::{Names, identifier};
use super::text::{Content, Literal, PrimText, Property};
use crate::error::{Error, Result};
use crate::formats::scene_file::MediumEntry;
use crate::formats::usd::fields::GridField;
use crate::math::Aabb;
use glam::DMat4;
use std::collections::BTreeMap;

/// A file of a volume.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VolumeFrame {
    /// Time code; `None` for a volume at rest.
    pub time: Option<u32>,
    /// Path from the stage's folder, which starts with `./` or `../`.
    pub path: String,
    /// Fields of the file.
    pub fields: Vec<GridField>,
}

/// A volume to be written.
#[derive(Debug, Clone)]
pub(crate) struct VolumePrim {
    /// Name of the prim.
    pub name: String,
    /// Files in ascending order of their time codes.
    pub frames: Vec<VolumeFrame>,
    /// Map from the files' space to that of the stage; `None` for the stage's own.
    pub placement: Option<DMat4>,
    /// Grids that play a part, such as `density`, by the part's name: they are related as `field:density` and the like,
    /// all others by their own names.
    pub parts: Vec<(&'static str, String)>,
    /// Medium.
    pub medium: MediumEntry,
    /// Path of the medium's transfer function from the stage's folder.
    pub transfer: Option<String>,
}

/// A field over all frames.
struct FieldPrim<'a> {
    first: &'a GridField,
    /// Path by time code; `None` at times whose file has no such grid.
    paths: Vec<(Option<u32>, Option<&'a str>)>,
}

impl VolumePrim {
    /// Returns the box around all frames in the space of the stage.
    pub(crate) fn bounds(&self) -> Aabb {
        let own = self.frames.iter().fold(Aabb::EMPTY, |all, frame| all.union(frame.bounds()));
        match self.placement {
            Some(map) if !own.is_empty() => {
                own.corners().into_iter().map(|corner| map.transform_point3(corner)).fold(Aabb::EMPTY, Aabb::including)
            }
            _ => own,
        }
    }

    /// Returns the volume's prim, which will lie beneath `parent`.
    ///
    /// # Errors
    /// If the grids of one name have values of different types.
    pub(crate) fn prim(&self, parent: &str, renderer: Renderer) -> Result<PrimText> {
        let path = format!("{parent}/{}", self.name);
        let mut volume = PrimText::new("Volume", self.name.clone());
        volume.metadata.push("prepend apiSchemas = [\"MaterialBindingAPI\"]".into());
        volume.properties.extend(self.extent());
        // The name of a variant's material is not for fields.
        let (mut names, mut relations) = (Names::default(), Names::default());
        names.take("material");
        self.parts.iter().for_each(|(part, _)| drop(relations.take(part)));
        for field in self.fields()? {
            let wanted = if field.first.index == 0 {
                identifier(&field.first.name)
            } else {
                format!("{}_{}", identifier(&field.first.name), field.first.index)
            };
            let name = names.take(&wanted);
            let part = self.parts.iter().find(|(_, grid)| field.first.is_called(grid));
            let relation = part.map_or_else(|| relations.take(&wanted), |(part, _)| (*part).to_owned());
            let target = format!("{path}/{name}");
            volume.properties.push(Property::relationship("custom rel", format!("field:{relation}"), target));
            volume.children.push(field.prim(name));
        }
        volume.properties.extend(medium::attributes(&self.medium, self.transfer.clone()));
        volume.variants.push(material::variants(renderer, &self.medium, &path));
        Ok(match self.placement {
            Some(map) => placed(volume, map),
            None => volume,
        })
    }

    /// Returns the boxes of the frames as attribute; `None` if there is nothing to be seen in any.
    fn extent(&self) -> Option<Property> {
        let boxes = self.frames.iter().map(|frame| (frame.time, frame.bounds()));
        let boxes: Vec<_> = boxes.filter(|(_, bounds)| !bounds.is_empty()).map(|(time, b)| (time, extent(b))).collect();
        let first = boxes.first()?.1.clone();
        let moving = boxes.iter().any(|(_, value)| *value != first);
        let samples = boxes.into_iter().filter_map(|(time, value)| Some((f64::from(time?), value))).collect();
        let content = if moving { Content::Samples(first, samples) } else { Content::Default(first) };
        Some(Property { declaration: "float3[]", name: "extent".into(), content })
    }

    /// Returns the fields of all frames in the order in which they occur.
    fn fields(&self) -> Result<Vec<FieldPrim<'_>>> {
        let mut all: Vec<FieldPrim> = Vec::new();
        let mut places = BTreeMap::new();
        for (done, frame) in self.frames.iter().enumerate() {
            for field in &frame.fields {
                let place = *places.entry((&field.name, field.index)).or_insert_with(|| {
                    let paths = self.frames[..done].iter().map(|frame| (frame.time, None)).collect();
                    all.push(FieldPrim { first: field, paths });
                    all.len() - 1
                });
                if field.data_type != all[place].first.data_type {
                    return Err(Error::unsupported(format!(
                        "grid '{}' has values of type {} in {}, of type {} before",
                        field.name,
                        field.data_type.unwrap_or("unknown"),
                        frame.path,
                        all[place].first.data_type.unwrap_or("unknown"),
                    ))
                    .hint(
                        "a field of USD has one type: write the files again with one, or leave the grid out by ⟨grid⟩",
                    ));
                }
                all[place].paths.push((frame.time, Some(&frame.path)));
            }
            all.iter_mut().filter(|field| field.paths.len() == done).for_each(|f| f.paths.push((frame.time, None)));
        }
        Ok(all)
    }
}

impl VolumeFrame {
    /// Returns the box around all grids in the space of the file.
    pub(crate) fn bounds(&self) -> Aabb {
        self.fields.iter().filter_map(|field| field.bounds).fold(Aabb::EMPTY, Aabb::union)
    }
}

impl FieldPrim<'_> {
    fn prim(&self, name: String) -> PrimText {
        let mut prim = PrimText::new("OpenVDBAsset", name);
        prim.set("token", "fieldName", Literal::text(&self.first.name));
        prim.set("int", "fieldIndex", Literal::Int(self.first.index as i64));
        if let Some(kind) = self.first.data_type {
            prim.set("token", "fieldDataType", Literal::text(kind));
            if kind.ends_with('3') {
                prim.set("token", "vectorDataRoleHint", Literal::text("Vector"));
            }
        }
        prim.set("token", "fieldClass", Literal::text(self.first.class));
        let asset = |path: &Option<&str>| path.map_or(Literal::Blocked, |path| Literal::Asset(path.to_owned()));
        let samples: Vec<(f64, Literal)> =
            self.paths.iter().filter_map(|(time, path)| Some((f64::from((*time)?), asset(path)))).collect();
        let first = self.paths.iter().find_map(|(_, path)| *path);
        let content =
            if samples.is_empty() { Content::Default(asset(&first)) } else { Content::Samples(asset(&first), samples) };
        prim.properties.push(Property { declaration: "asset", name: "filePath".into(), content });
        prim
    }
}

/// Returns a box as an extent in single precision that contains it.
pub(crate) fn extent(bounds: Aabb) -> Literal {
    let below = |v: f64| if f64::from(v as f32) > v { (v as f32).next_down() } else { v as f32 };
    let above = |v: f64| if f64::from(v as f32) < v { (v as f32).next_up() } else { v as f32 };
    Literal::Array(vec![
        Literal::floats(bounds.min.to_array().map(below)),
        Literal::floats(bounds.max.to_array().map(above)),
    ])
}
