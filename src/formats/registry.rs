//! The formats that files are read from and written to, one row each. A new format is a module and a row here: it is
//! then detected, described, converted and shown as those of its kind are, and named where others are.

use super::ending::ends_in;
use super::exr::deep;
use super::format::{FileKind, Format};
use super::imaging::options::ReadOption::{Array, Axes, Channel, Level, Placement, Series, Time};
use super::imaging::write::{self, Target};
use super::imaging::{
    self, ImageFormat, cvol, dicom, meta_image, mitsuba, mrc, nifti, nrrd, numpy, raw, tiff, vtk, zarr,
};
use super::mesh::{MeshFormat, gltf, obj, ply};
use super::raster::{PictureFormat, jpeg, png as png_reader};
use super::{colmap, png};
use crate::error::{Code, Error, Result};
use crate::text::listed;
use std::path::Path;

/// Number of bytes by which formats are recognized.
const START: u64 = 1024;
/// Endings of the names of stages, which tell packages: these are archives.
const STAGES: &[&str] = &["usd", "usda", "usdc", "usdz"];

/// OpenVDB's files.
pub static VDB: Format = Format {
    name: "VDB",
    phrase: "an OpenVDB file",
    endings: &["vdb"],
    frames: true,
    recognizes: |_, start| Ok(start.starts_with(b" BDV")),
    kind: FileKind::Vdb,
};

/// OpenEXR's pictures.
pub static EXR: Format = Format {
    name: "OpenEXR",
    phrase: "an OpenEXR picture",
    endings: &["exr"],
    frames: true,
    recognizes: |_, start| Ok(start.starts_with(&[0x76, 0x2f, 0x31, 0x01])),
    kind: FileKind::Exr,
};

/// Deep pictures of OpenEXR, whose files' names are those of flat ones.
pub static DEEP_EXR: Format = Format {
    name: "deep OpenEXR",
    phrase: "a deep OpenEXR picture",
    endings: &[],
    frames: true,
    recognizes: |_, start| Ok(deep::states_deep(start)),
    kind: FileKind::DeepExr,
};

/// Arrays of NumPy: volumes, and pictures of one, three or four channels.
pub static NPY: Format = Format {
    name: ".npy",
    phrase: "an array of NumPy",
    endings: &["npy"],
    frames: true,
    recognizes: |_, start| Ok(start.starts_with(b"\x93NUMPY")),
    kind: FileKind::Image(&ImageFormat {
        read: numpy::open,
        options: &[Placement, Axes],
        targets: &[Target {
            ending: "npy",
            file: |path, grid, _, axes| write::npy::write(path, grid, axes),
            beside: None,
        }],
    }),
};

/// Numbers without a header, which are not recognized: the caller states their layout.
pub static RAW: Format = Format {
    name: "raw",
    phrase: "a file without a header",
    endings: &["raw"],
    frames: false,
    recognizes: |_, _| Ok(false),
    kind: FileKind::Image(&ImageFormat {
        read: |path, options, _| raw::open(path, options),
        options: &[Placement],
        targets: &[],
    }),
};

/// Stand-in for the format of files of no known kind.
static UNKNOWN: Format = Format {
    name: "unknown",
    phrase: "a file of no known kind",
    endings: &[],
    frames: false,
    recognizes: |_, _| Ok(true),
    kind: FileKind::Unknown,
};

/// All formats, in the order in which a file is held against them.
pub static FORMATS: &[&Format] = &[
    &VDB,
    &Format {
        name: "NanoVDB",
        phrase: "a NanoVDB file",
        endings: &["nvdb"],
        frames: true,
        recognizes: |_, start| Ok(start.starts_with(b"NanoVDB")),
        kind: FileKind::NanoVdb,
    },
    // Before flat pictures, which begin alike.
    &DEEP_EXR,
    &EXR,
    &Format {
        name: "USD",
        phrase: "a USD stage",
        endings: STAGES,
        frames: true,
        recognizes: |path, start| {
            let stated = start.starts_with(b"PXR-USDC") || without_mark(start).starts_with(b"#usda");
            Ok(stated || !path.is_dir() && STAGES.iter().any(|ending| ends_in(path, ending)))
        },
        kind: FileKind::Usd,
    },
    // Before captures: its metadata are JSON, too.
    &Format {
        name: "Zarr",
        phrase: "a Zarr image or array",
        endings: &["zarr"],
        frames: false,
        recognizes: |path, _| Ok(zarr::is_zarr(path)),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, limits| zarr::open(path, options, limits).map(|image| vec![image]),
            options: &[Placement, Time, Channel, Level],
            targets: &[],
        }),
    },
    &Format {
        name: "glTF",
        phrase: "a glTF scene",
        endings: &["glb", "gltf"],
        frames: false,
        recognizes: |path, start| Ok(start.starts_with(b"glTF") || !path.is_dir() && ends_in(path, "gltf")),
        kind: FileKind::Mesh(&MeshFormat { read: gltf::read, write: None }),
    },
    &Format {
        name: "capture",
        phrase: "a capture, a scene file or a folder",
        endings: &["json"],
        frames: false,
        // COLMAP's files have fixed names and no magic number. A folder's reader decides whether it holds a capture.
        recognizes: |path, start| {
            let first = without_mark(start).iter().find(|byte| !byte.is_ascii_whitespace());
            Ok(path.is_dir() || colmap::is_model_file(path) || first == Some(&b'{'))
        },
        kind: FileKind::Capture,
    },
    &Format {
        name: "PNG",
        phrase: "a PNG picture",
        endings: &["png"],
        frames: false,
        recognizes: |_, start| Ok(start.starts_with(b"\x89PNG")),
        kind: FileKind::Picture(&PictureFormat {
            header: png_reader::header,
            read: png_reader::read,
            write: Some(png::write_film),
        }),
    },
    &Format {
        name: "JPEG",
        phrase: "a JPEG picture",
        endings: &["jpg", "jpeg"],
        frames: false,
        recognizes: |_, start| Ok(start.starts_with(&[0xff, 0xd8, 0xff])),
        kind: FileKind::Picture(&PictureFormat { header: jpeg::header, read: jpeg::read, write: None }),
    },
    // Before TIFF: the preamble of a DICOM file may be the header of one.
    &Format {
        name: "DICOM",
        phrase: "a DICOM series",
        endings: dicom::ENDINGS,
        frames: false,
        recognizes: |path, start| Ok(dicom::is_dicom(start) || path.is_dir() && dicom::is_series(path)),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, limits| dicom::open(path, options, limits).map(|image| vec![image]),
            options: &[Placement, Time, Series],
            targets: &[],
        }),
    },
    &Format {
        name: "TIFF",
        phrase: "a TIFF stack",
        endings: tiff::ENDINGS,
        frames: false,
        recognizes: |path, start| Ok(tiff::is_tiff(start) || tiff::is_stack(path)),
        kind: FileKind::Image(&ImageFormat { read: tiff::open, options: &[Placement, Time, Array], targets: &[] }),
    },
    &NPY,
    &Format {
        name: ".npz",
        phrase: "an archive of NumPy's arrays",
        endings: &["npz"],
        frames: false,
        recognizes: |_, start| Ok(numpy::is_archive(start)),
        kind: FileKind::Image(&ImageFormat {
            read: numpy::open_archive,
            options: &[Placement, Array, Axes],
            targets: &[],
        }),
    },
    &Format {
        name: "NIfTI",
        phrase: "a NIfTI image",
        endings: &["nii", "nii.gz", "hdr", "img"],
        frames: true,
        recognizes: is_nifti,
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, _| nifti::open(path, options),
            options: &[Time],
            targets: &[
                Target { ending: "nii", file: |path, grid, _, _| write::nifti::write(path, grid, false), beside: None },
                Target {
                    ending: "nii.gz",
                    file: |path, grid, _, _| write::nifti::write(path, grid, true),
                    beside: None,
                },
            ],
        }),
    },
    &Format {
        name: "NRRD",
        phrase: "an NRRD image",
        endings: &["nrrd", "nhdr"],
        frames: true,
        recognizes: |_, start| Ok(start.starts_with(b"NRRD000")),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, _| nrrd::open(path, options),
            options: &[Time],
            targets: &[Target {
                ending: "nrrd",
                file: |path, grid, _, _| write::nrrd::write(path, grid),
                beside: None,
            }],
        }),
    },
    &Format {
        name: "MetaImage",
        phrase: "a MetaImage",
        endings: &["mha", "mhd"],
        frames: true,
        recognizes: |_, start| Ok(meta_image::is_meta_image(start)),
        kind: FileKind::Image(&ImageFormat {
            read: |path, _, _| meta_image::open(path),
            options: &[],
            targets: &[
                Target { ending: "mha", file: |path, grid, _, _| write::meta_image::write(path, grid), beside: None },
                Target {
                    ending: "mhd",
                    file: |path, grid, _, _| write::meta_image::write_apart(path, grid),
                    beside: Some("raw"),
                },
            ],
        }),
    },
    &Format {
        name: ".vti",
        phrase: "image data of VTK",
        endings: &["vti"],
        frames: true,
        recognizes: |_, start| Ok(vtk::is_xml(start)),
        kind: FileKind::Image(&ImageFormat {
            read: vtk::open_xml,
            options: &[Array],
            targets: &[Target {
                ending: "vti",
                file: |path, grid, name, _| write::vti::write(path, grid, name),
                beside: None,
            }],
        }),
    },
    &Format {
        name: "legacy VTK",
        phrase: "a legacy file of VTK",
        endings: &["vtk"],
        frames: true,
        recognizes: |_, start| Ok(start.starts_with(b"# vtk DataFile")),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, _| vtk::open_legacy(path, options),
            options: &[Array],
            targets: &[],
        }),
    },
    &Format {
        name: "MRC",
        phrase: "an MRC map",
        endings: &["mrc", "map", "ccp4"],
        frames: true,
        recognizes: |path, start| Ok(mrc::is_mrc(start) || mrc::is_packed_mrc(path, start)?),
        kind: FileKind::Image(&ImageFormat {
            read: |path, _, _| mrc::open(path).map(|image| vec![image]),
            options: &[],
            targets: &[],
        }),
    },
    &Format {
        name: ".cvol",
        phrase: "a volume of DiffDVR or fV-SRN",
        endings: &["cvol"],
        frames: false,
        recognizes: |_, start| Ok(cvol::is_cvol(start)),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, _| cvol::open(path, options),
            options: &[Array],
            targets: &[],
        }),
    },
    &Format {
        name: ".vol",
        phrase: "a grid of Mitsuba",
        endings: &["vol"],
        frames: true,
        recognizes: |path, start| Ok(mitsuba::is_vol(path, start)),
        kind: FileKind::Image(&ImageFormat {
            read: |path, options, _| mitsuba::open(path, options).map(|image| vec![image]),
            options: &[Placement],
            targets: &[Target {
                ending: "vol",
                file: |path, grid, _, _| write::mitsuba::write(path, grid),
                beside: None,
            }],
        }),
    },
    &Format {
        name: "PLY",
        phrase: "a PLY mesh",
        endings: &["ply"],
        frames: false,
        recognizes: |_, start| Ok(start.starts_with(b"ply\n") || start.starts_with(b"ply\r")),
        kind: FileKind::Mesh(&MeshFormat { read: ply::read, write: Some(ply::write) }),
    },
    // Its files state nothing of themselves.
    &Format {
        name: "OBJ",
        phrase: "a Wavefront OBJ mesh",
        endings: &["obj"],
        frames: false,
        recognizes: |path, _| Ok(!path.is_dir() && ends_in(path, "obj")),
        kind: FileKind::Mesh(&MeshFormat { read: obj::read, write: Some(obj::write) }),
    },
];

/// True for NIfTI. The word of MRC may stand in the description of an image, and the header of a map may begin as that
/// of Analyze 7.5 does, which counts as NIfTI for the reader to refuse.
fn is_nifti(path: &Path, start: &[u8]) -> Result<bool> {
    Ok(nifti::states_itself(start) || !mrc::is_mrc(start) && nifti::is_nifti(path, start))
}

/// A text without the byte order mark that editors put before it.
fn without_mark(start: &[u8]) -> &[u8] {
    start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start)
}

/// Returns the first of the `wanted` formats that a file, a folder or the files of a pattern have, by their content;
/// names matter where content says nothing. None if it is none of these.
///
/// # Errors
/// If nothing is there, the path is no regular file (a device, a FIFO, a socket), or cannot be read.
pub fn find(path: &Path, wanted: impl Fn(FileKind) -> bool) -> Result<Option<&'static Format>> {
    let start = if path.is_dir() || !path.exists() { Vec::new() } else { imaging::input::start(path, START)? };
    for format in FORMATS.iter().filter(|format| wanted(format.kind)) {
        if (format.recognizes)(path, &start)? {
            return Ok(Some(format));
        }
    }
    std::fs::metadata(path).map(|_| None).map_err(|e| Error::io(path, e))
}

/// Returns the format of a file or folder among all, as [`find`] does, or a stand-in of [`FileKind::Unknown`].
///
/// # Errors
/// The conditions are those of [`find`], and patterns name nothing here.
pub fn sniff(path: &Path) -> Result<&'static Format> {
    std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    Ok(find(path, |_| true)?.unwrap_or(&UNKNOWN))
}

/// Returns the format whose files' names end as that of a path does.
pub(crate) fn by_name(path: &Path) -> Option<&'static Format> {
    FORMATS.iter().copied().find(|format| format.has_name(path))
}

/// Returns the names of the formats of some kinds.
pub(crate) fn names(wanted: impl Fn(FileKind) -> bool) -> Vec<&'static str> {
    FORMATS.iter().filter(|format| wanted(format.kind)).map(|format| format.name).collect()
}

/// Returns the endings of the files of some kinds, without the dot.
pub(crate) fn endings(wanted: impl Fn(FileKind) -> bool) -> Vec<&'static str> {
    FORMATS.iter().filter(|format| wanted(format.kind)).flat_map(|format| format.endings).copied().collect()
}

/// Returns the endings of the files of some kinds that are frames of sequences where they are numbered.
pub(crate) fn frame_endings(wanted: impl Fn(FileKind) -> bool) -> Vec<&'static str> {
    let frames = FORMATS.iter().filter(|format| format.frames && wanted(format.kind));
    frames.flat_map(|format| format.endings).copied().collect()
}

/// Returns the error for a file whose format a command does not read: what the file is, if a conversion leads on.
pub fn unread(format: &Format, path: &Path) -> Error {
    let words = match format.kind {
        FileKind::Unknown => "no file of a known kind".to_owned(),
        _ => format!("this is {}, which this command does not read", format.phrase),
    };
    Error::unsupported(words)
        .hint(format!(
            "OpenVDB files, USD stages and pictures ({}) are understood, and captures: a transforms.json, a model of \
             COLMAP, or the folder that holds one; and grids of {}, and meshes ({}), which become an OpenVDB file with \
             cumulo convert",
            listed(&names(FileKind::is_picture), "and"),
            listed(&names(|kind| matches!(kind, FileKind::Image(_) | FileKind::NanoVdb)), "and"),
            listed(&names(|kind| matches!(kind, FileKind::Mesh(_))), "and")
        ))
        .coded(Code::UnknownFormat)
        .at(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn rows_have_names_and_endings_of_their_own() {
        let names: BTreeSet<&str> = FORMATS.iter().chain(&[&RAW, &UNKNOWN]).map(|format| format.name).collect();
        assert_eq!(names.len(), FORMATS.len() + 2);
        let mut endings = BTreeSet::new();
        for format in FORMATS {
            assert!(!format.endings.is_empty() || *format == &DEEP_EXR, "{}", format.name);
            for ending in format.endings {
                assert!(endings.insert(*ending), "'{ending}' of {} is that of another format", format.name);
                assert!(!ending.starts_with('.') && *ending == ending.to_ascii_lowercase(), "{ending}");
                let path = format!("a/b.c.{}", ending.to_ascii_uppercase());
                assert_eq!(by_name(Path::new(&path)).map(|found| found.name), Some(format.name), "{path}");
            }
            if let FileKind::Image(image) = format.kind {
                let known = |target: &Target| format.endings.contains(&target.ending);
                assert!(image.targets.iter().all(known), "{} is written to names that are not its own", format.name);
            }
        }
        for none in ["nii", "b.gz", "b", "", "smoke.0001"] {
            assert!(by_name(Path::new(none)).is_none(), "{none}");
        }
    }

    #[test]
    fn advice_names_the_formats() {
        let advice = unread(&UNKNOWN, Path::new("a")).to_string();
        for name in names(|kind| matches!(kind, FileKind::Image(_) | FileKind::Picture(_) | FileKind::Mesh(_))) {
            assert!(advice.contains(name), "{name}: {advice}");
        }
        assert_eq!(endings(FileKind::is_picture), ["exr", "png", "jpg", "jpeg"]);
    }
}
