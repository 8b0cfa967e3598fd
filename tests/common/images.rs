//! One small volume in every format that is read, and in every way in which a format holds it.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use cumulo::formats::format::FileKind;
use cumulo::formats::imaging::ImageFormat;
use cumulo::formats::imaging::write::Target;
use cumulo::formats::{registry, sample};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DMat3, DMat4, DQuat, DVec3, EulerRot};
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

pub const SIZE: [usize; 3] = [5, 4, 3];

/// No two voxels are alike, and none is 0.
pub fn value(x: usize, y: usize, z: usize) -> u8 {
    (1 + x + 5 * y + 20 * z) as u8
}

/// The values, x fastest.
pub fn values() -> Vec<u8> {
    let [nx, ny, nz] = SIZE;
    (0..nx * ny * nz).map(|i| value(i % nx, i / nx % ny, i / nx / ny)).collect()
}

/// Voxels that are no cubes, at an origin; every number is exact in single precision.
pub fn straight() -> DMat4 {
    DMat4::from_translation(DVec3::new(10.5, -20.25, 30.125)) * DMat4::from_scale(DVec3::new(0.5, 0.75, 1.25))
}

/// These voxels turned about three axes.
pub fn oblique() -> DMat4 {
    DMat4::from_translation(DVec3::new(10.5, -20.25, 30.125))
        * DMat4::from_quat(turn())
        * DMat4::from_scale(DVec3::new(0.5, 0.75, 1.25))
}

fn turn() -> DQuat {
    DQuat::from_euler(EulerRot::XYZ, 0.3, -0.5, 0.7)
}

/// A volume in a format.
pub struct Sample {
    pub name: &'static str,
    /// Names and contents; the first one is opened.
    pub files: Vec<(&'static str, Vec<u8>)>,
    /// Options of `cumulo convert`.
    pub options: &'static str,
    /// Where its voxels lie.
    pub map: DMat4,
    /// Largest error of a position, from the precision of the format's numbers.
    pub tolerance: f64,
}

impl Sample {
    pub fn write(&self, folder: &Path) -> PathBuf {
        self.files.iter().for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes).unwrap());
        folder.join(self.files[0].0)
    }
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn u16s(big: bool) -> Vec<u8> {
    values().iter().flat_map(|v| if big { u16::from(*v).to_be_bytes() } else { u16::from(*v).to_le_bytes() }).collect()
}

fn floats() -> Vec<u8> {
    values().iter().flat_map(|v| f32::from(*v).to_le_bytes()).collect()
}

/// Rounds a map as single precision does.
fn single(map: DMat4) -> DMat4 {
    DMat4::from_cols_array(&map.to_cols_array().map(|v| f64::from(v as f32)))
}

/// A header of NIfTI-1 without extension: 352 bytes, or 348 of a pair.
pub fn nifti1(kind: i16, times: i16, (sform, qform): (Option<DMat4>, bool), big: bool, pair: bool) -> Vec<u8> {
    let mut bytes = vec![0; if pair { 348 } else { 352 }];
    let mut put = |at: usize, mut new: Vec<u8>| {
        if big {
            new.reverse();
        }
        bytes[at..at + new.len()].copy_from_slice(&new);
    };
    let short = |v: i16| v.to_le_bytes().to_vec();
    let real = |v: f64| (v as f32).to_le_bytes().to_vec();
    put(0, 348_i32.to_le_bytes().to_vec());
    let rank = if times > 1 { 4 } else { 3 };
    let dims = [rank, SIZE[0] as i16, SIZE[1] as i16, SIZE[2] as i16, times, 1, 1, 1];
    dims.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, short(*n)));
    put(70, short(kind));
    [1.0, 0.5, 0.75, 1.25].iter().enumerate().for_each(|(i, v)| put(76 + 4 * i, real(*v)));
    put(108, real(if pair { 0.0 } else { 352.0 }));
    if let Some(map) = sform {
        put(254, short(1));
        (0..12).for_each(|i| put(280 + 4 * i, real(map.row(i / 4)[i % 4])));
    }
    if qform {
        put(252, short(1));
        let q = turn();
        let sign = q.w.signum();
        [q.x, q.y, q.z].iter().enumerate().for_each(|(i, v)| put(256 + 4 * i, real(v * sign)));
        [10.5, -20.25, 30.125].iter().enumerate().for_each(|(i, v)| put(268 + 4 * i, real(*v)));
    }
    bytes[344..348].copy_from_slice(if pair { b"ni1\0" } else { b"n+1\0" });
    bytes
}

fn nifti2(map: DMat4) -> Vec<u8> {
    let mut bytes = vec![0; 544];
    let mut put = |at: usize, new: &[u8]| bytes[at..at + new.len()].copy_from_slice(new);
    put(0, &540_i32.to_le_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &2_i16.to_le_bytes());
    let dims = [3, SIZE[0], SIZE[1], SIZE[2], 1, 1, 1, 1];
    dims.iter().enumerate().for_each(|(i, n)| put(16 + 8 * i, &(*n as i64).to_le_bytes()));
    put(168, &544_i64.to_le_bytes());
    put(348, &1_i32.to_le_bytes());
    (0..12).for_each(|i| put(400 + 8 * i, &map.row(i / 4)[i % 4].to_le_bytes()));
    bytes
}

fn vector(v: DVec3) -> String {
    format!("({:?},{:?},{:?})", v.x, v.y, v.z)
}

/// Fields of NRRD of this map, which is one to right, anterior, superior.
fn nrrd(kind: &str, encoding: &str, map: DMat4, lps: bool) -> String {
    let sign = if lps { DVec3::new(-1.0, -1.0, 1.0) } else { DVec3::ONE };
    let columns = [map.x_axis, map.y_axis, map.z_axis].map(|c| vector(c.truncate() * sign));
    let space = if lps { "left-posterior-superior" } else { "RAS" };
    format!(
        "NRRD0004\n# a comment\ntype: {kind}\ndimension: 3\nspace: {space}\nsizes: 5 4 3\nspace directions: {}\nendian: big\n\
         encoding: {encoding}\nspace origin: {}\nnote:=a:b\n",
        columns.join(" "),
        vector(map.w_axis.truncate() * sign)
    )
}

fn meta_image(map: DMat4, kind: &str, more: &str, data: &str) -> String {
    let flip = |v: DVec3| [-v.x, -v.y, v.z];
    let linear = DMat3::from_mat4(map);
    let spacing = [linear.x_axis, linear.y_axis, linear.z_axis].map(|c| c.length());
    let columns = [linear.x_axis / spacing[0], linear.y_axis / spacing[1], linear.z_axis / spacing[2]];
    let list = |v: &[f64]| v.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(" ");
    format!(
        "ObjectType = Image\nNDims = 3\n{more}TransformMatrix = {}\nOffset = {}\nElementSpacing = {}\nDimSize = 5 4 3\n\
         ElementType = {kind}\nElementDataFile = {data}\n",
        list(&columns.iter().flat_map(|c| flip(*c)).collect::<Vec<_>>()),
        list(&flip(map.w_axis.truncate())),
        list(&spacing)
    )
}

fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    while !(text.len() + 11).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), data].concat()
}

/// The values with z fastest, as `array[x, y, z]` has them.
fn z_fastest() -> Vec<u8> {
    let [nx, ny, nz] = SIZE;
    (0..nx * ny * nz).map(|i| value(i / nz / ny, i / nz % ny, i % nz)).collect()
}

fn npz() -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    archive.start_file("density.npy", options).unwrap();
    archive.write_all(&npy("<f4", true, "(5, 4, 3)", &floats())).unwrap();
    archive.start_file("line.npy", options.compression_method(zip::CompressionMethod::Stored)).unwrap();
    archive.write_all(&npy("|u1", false, "(5,)", &[1; 5])).unwrap();
    archive.finish().unwrap().into_inner()
}

/// A TIFF of these pages, each of 16-bit numbers, with a description and a resolution in its first page.
pub fn tiff(pages: &[Vec<u16>], width: u32, height: u32, description: &str, per_unit: [u32; 2]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut file).unwrap();
    for (number, page) in pages.iter().enumerate() {
        let mut image = encoder.new_image::<tiff::encoder::colortype::Gray16>(width, height).unwrap();
        if number == 0 && !description.is_empty() {
            image.encoder().write_tag(tiff::tags::Tag::ImageDescription, description).unwrap();
            image.x_resolution(tiff::encoder::Rational { n: per_unit[0], d: 3 });
            image.y_resolution(tiff::encoder::Rational { n: per_unit[1], d: 3 });
        }
        image.write_data(page).unwrap();
    }
    file.into_inner()
}

fn stack() -> Vec<u8> {
    let pages: Vec<Vec<u16>> = values().chunks(20).map(|page| page.iter().map(|v| u16::from(*v)).collect()).collect();
    // 6 / 3 and 4 / 3 pixels per unit.
    tiff(&pages, 5, 4, "ImageJ=1.53t\nimages=3\nslices=3\nunit=mm\nspacing=1.25\n", [6, 4])
}

fn legacy(binary: bool, cells: bool) -> Vec<u8> {
    let (kind, data) = if binary {
        ("BINARY", u16s(true))
    } else {
        ("ASCII", values().iter().flat_map(|v| format!("{v} ").into_bytes()).collect())
    };
    // A cell is centred half a spacing further in than its first point.
    let (dimensions, of, origin) = if cells {
        ("6 5 4", "CELL_DATA", "10.25 -20.625 29.5")
    } else {
        ("5 4 3", "POINT_DATA", "10.5 -20.25 30.125")
    };
    let head = format!(
        "# vtk DataFile Version 3.0\na title\n{kind}\nDATASET STRUCTURED_POINTS\nDIMENSIONS {dimensions}\nSPACING 0.5 0.75 1.25\n\
         ORIGIN {origin}\n{of} 60\nSCALARS density unsigned_short 1\nLOOKUP_TABLE default\n"
    );
    [head.as_bytes(), &data, b"\n"].concat()
}

/// VTK's XML with the array's values in the piece (`inline`) or behind it.
fn vti(map: DMat4, attributes: &str, format: &str, inline: &str, appended: &[u8]) -> Vec<u8> {
    let linear = DMat3::from_mat4(map);
    let spacing = [linear.x_axis, linear.y_axis, linear.z_axis].map(|c| c.length());
    let turn = DMat3::from_cols(linear.x_axis / spacing[0], linear.y_axis / spacing[1], linear.z_axis / spacing[2])
        .transpose();
    // The first point has index (2, 0, -1).
    let origin = map.transform_point3(DVec3::new(-2.0, 0.0, 1.0));
    let list = |v: &[f64]| v.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(" ");
    let head = format!(
        "<?xml version=\"1.0\"?>\n<!-- a > comment -->\n<VTKFile type=\"ImageData\" version=\"1.0\" {attributes}>\n\
         <ImageData WholeExtent=\"2 6 0 3 -1 1\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\">\n<Piece Extent=\"2 6 0 3 -1 1\">\n\
         <PointData Scalars=\"density\">\n<DataArray type=\"UInt16\" Name=\"density\" NumberOfComponents=\"1\" {format}>{inline}\
         </DataArray>\n</PointData>\n<CellData/>\n</Piece>\n</ImageData>\n",
        list(&origin.to_array()),
        list(&spacing),
        list(&turn.to_cols_array())
    );
    [head.as_bytes(), appended, b"</VTKFile>\n"].concat()
}

/// Blocks of 64 bytes, packed, behind their table.
fn blocks() -> (Vec<u8>, Vec<u8>) {
    let packed: Vec<Vec<u8>> = u16s(false).chunks(64).map(zlib).collect();
    let table = [packed.len(), 64, 120 % 64].into_iter().chain(packed.iter().map(Vec::len));
    (table.flat_map(|n| (n as u32).to_le_bytes()).collect(), packed.concat())
}

fn appended(encoding: &str, data: &[u8]) -> Vec<u8> {
    [format!("<AppendedData encoding=\"{encoding}\">\n_").as_bytes(), data, b"\n</AppendedData>\n"].concat()
}

/// Name of the format of images that a file or folder has, by its content.
pub fn found(path: &Path) -> Option<&'static str> {
    registry::find(path, |kind| matches!(kind, FileKind::Image(_))).unwrap().map(|format| format.name)
}

/// Format of images of this name.
pub fn format_of(name: &str) -> &'static ImageFormat {
    let of_name = registry::FORMATS.iter().copied().chain([&registry::RAW]).find(|format| format.name == name);
    match of_name.unwrap().kind {
        FileKind::Image(format) => format,
        kind => panic!("{name} is {kind:?}"),
    }
}

/// Grid of Mitsuba in an encoding, of 32-bit (1) or half floats (2), in the box of the straight voxels.
pub fn mitsuba(encoding: i32, values: &[u8]) -> Vec<u8> {
    let mut file = b"VOL\x03".to_vec();
    let sizes = SIZE.map(|n| n as i32);
    [encoding, sizes[0], sizes[1], sizes[2], 1].iter().for_each(|n| file.extend(n.to_le_bytes()));
    let map = straight();
    for corner in [DVec3::splat(-0.5), DVec3::from_array(SIZE.map(|n| n as f64 - 0.5))] {
        map.transform_point3(corner).as_vec3().to_array().iter().for_each(|v| file.extend(v.to_le_bytes()));
    }
    let sample = if encoding == 1 { sample::Sample::F32 } else { sample::Sample::F16 };
    sample.encode(&values.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), &mut file);
    file
}

/// All forms in which images are written.
pub fn targets() -> impl Iterator<Item = &'static Target> {
    registry::FORMATS.iter().flat_map(|format| match format.kind {
        FileKind::Image(format) => format.targets,
        _ => &[],
    })
}

/// The volume in every format.
pub fn samples() -> Vec<Sample> {
    // The largest coordinate is below 64, and sums of four products round by a few units in its last place.
    let (double, float) = (64.0 * 4.0 * f64::EPSILON, 64.0 * 4.0 * f64::from(f32::EPSILON));
    let (map, axes) = (oblique(), straight());
    let sample = |name, files, options, map, tolerance| Sample { name, files, options, map, tolerance };
    let placed = "--transform=@";
    let mut all = vec![
        sample("NIfTI-1", vec![("a.nii", [nifti1(2, 1, (Some(map), false), false, false), values()].concat())], "", single(map), 0.0),
        sample("NIfTI-1, big endian, qform", vec![("b.nii", [nifti1(512, 1, (None, true), true, false), u16s(true)].concat())], "", map, float),
        sample("NIfTI-1, packed", vec![("c.nii.gz", gzip(&[nifti1(16, 1, (Some(map), true), false, false), floats()].concat()))], "", single(map), 0.0),
        sample("NIfTI-2", vec![("d.nii", [nifti2(map), values()].concat())], "", map, 0.0),
        sample("NIfTI, pair", vec![("e.hdr", nifti1(2, 1, (Some(axes), false), false, true)), ("e.img", values())], "", axes, 0.0),
        sample("NRRD, raw", vec![("a.nrrd", [nrrd("ushort", "raw", map, true).as_bytes(), b"\n", &u16s(true)].concat())], "", map, 0.0),
        sample("NRRD, ascii", vec![("b.nrrd", [nrrd("uchar", "ascii", map, false).as_bytes(), b"\n", values().iter().map(|v| format!("{v}\n")).collect::<String>().as_bytes()].concat())], "", map, 0.0),
        sample("NRRD, detached", vec![("c.nhdr", [nrrd("ushort", "gzip", map, true).as_bytes(), b"data file: c.raw.gz\n"].concat()), ("c.raw.gz", gzip(&u16s(true)))], "", map, 0.0),
        sample("NRRD, spacings", vec![("d.nrrd", [b"NRRD0001\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspacings: 0.5 0.75 1.25\naxis mins: 10.25 -20.25 29.5\ncenters: cell node cell\nencoding: raw\n\n", &values()[..]].concat())], "", axes, 0.0),
        sample("MetaImage", vec![("a.mha", [meta_image(map, "MET_USHORT", "BinaryDataByteOrderMSB = True\n", "LOCAL").as_bytes(), &u16s(true)].concat())], "", map, double),
        sample("MetaImage, apart", vec![("b.mhd", meta_image(map, "MET_FLOAT", "CompressedData = True\n", "b.zraw").into_bytes()), ("b.zraw", zlib(&floats()))], "", map, double),
        sample("raw", vec![("a.bin", [b"7 bytes", &u16s(true)[..]].concat())], "--dims 5,4,3 --type u16 --endian big --skip 7 --spacing 0.5,0.75,1.25 --origin=10.5,-20.25,30.125", axes, 0.0),
        sample("NumPy", vec![("a.npy", npy("|u1", false, "(5, 4, 3)", &z_fastest()))], placed, map, 0.0),
        sample("NumPy, column-major", vec![("b.npy", npy("<f4", true, "(5, 4, 3)", &floats()))], placed, map, 0.0),
        sample("NumPy, zyx", vec![("c.npy", npy(">u2", false, "(3, 4, 5)", &u16s(true)))], "--axes zyx --transform=@", map, 0.0),
        sample("NumPy's archive", vec![("a.npz", npz())], placed, map, 0.0),
        sample("TIFF", vec![("a.tif", stack())], "--origin=10.5,-20.25,30.125", axes, 0.0),
        sample("legacy VTK, ascii", vec![("a.vtk", legacy(false, false))], "", axes, 0.0),
        sample("legacy VTK, binary", vec![("b.vtk", legacy(true, false))], "", axes, 0.0),
        sample("legacy VTK, cells", vec![("c.vtk", legacy(true, true))], "", axes, 0.0),
    ];
    all.extend([(1, "m.vol"), (2, "h.vol")].map(|(encoding, name)| {
        let title = if encoding == 1 { "Mitsuba" } else { "Mitsuba, half floats" };
        sample(title, vec![(name, mitsuba(encoding, &values()))], "", axes, 0.0)
    }));
    all.extend(xml(map, double));
    all.extend(apart(map, double));
    all
}

/// Headers with a file for each slice, as a list or a pattern, and values as text.
fn apart(map: DMat4, tolerance: f64) -> Vec<Sample> {
    let slices =
        |names: [&'static str; 3]| names.into_iter().zip(values().chunks(20).map(<[u8]>::to_vec).collect::<Vec<_>>());
    let list = [nrrd("uchar", "raw", map, true).as_bytes(), b"data file: LIST\nn1.raw\nn2.raw\nn3.raw\n"].concat();
    let pattern = meta_image(map, "MET_UCHAR", "", "m%02d.raw 7 9 1").into_bytes();
    let text: String = values().iter().map(|v| format!(" {v}.0")).collect();
    let text = [meta_image(map, "MET_FLOAT", "BinaryData = False\n", "LOCAL").as_bytes(), text.as_bytes()].concat();
    let sample = |name, files, tolerance| Sample { name, files, options: "", map, tolerance };
    vec![
        sample(
            "NRRD, list",
            [("l.nhdr", list)].into_iter().chain(slices(["n1.raw", "n2.raw", "n3.raw"])).collect(),
            0.0,
        ),
        sample(
            "MetaImage, pattern",
            [("p.mhd", pattern)].into_iter().chain(slices(["m07.raw", "m08.raw", "m09.raw"])).collect(),
            tolerance,
        ),
        sample("MetaImage, text", vec![("t.mha", text)], tolerance),
    ]
}

/// Every encoding of VTK's XML.
fn xml(map: DMat4, tolerance: f64) -> Vec<Sample> {
    let text: String = values().iter().map(|v| format!("{v} ")).collect();
    let counted = [&120_u32.to_le_bytes()[..], &u16s(false)].concat();
    let wide = [&120_u64.to_be_bytes()[..], &u16s(true)].concat();
    let (table, packed) = blocks();
    let coded = format!("{}{}", STANDARD.encode(&table), STANDARD.encode(&packed));
    let (little, zip) = (
        "byte_order=\"LittleEndian\"",
        "byte_order=\"LittleEndian\" header_type=\"UInt32\" compressor=\"vtkZLibDataCompressor\"",
    );
    let at = "format=\"appended\" offset=\"0\"";
    let file =
        |attributes: &str, format: &str, inline: &str, behind: &[u8]| vti(map, attributes, format, inline, behind);
    let all: [(&'static str, &'static str, Vec<u8>); 6] = [
        (".vti, ascii", "a.vti", file(little, "format=\"ascii\"", &text, b"")),
        (
            ".vti, base64",
            "b.vti",
            file(little, "format=\"binary\"", &format!("\n {}\n", STANDARD.encode(&counted)), b""),
        ),
        (".vti, packed", "c.vti", file(zip, "format=\"binary\"", &coded, b"")),
        (
            ".vti, appended",
            "d.vti",
            file("byte_order=\"BigEndian\" header_type=\"UInt64\"", at, "", &appended("raw", &wide)),
        ),
        (".vti, appended and packed", "e.vti", file(zip, at, "", &appended("raw", &[table, packed].concat()))),
        (
            ".vti, appended base64",
            "f.vti",
            file(little, at, "", &appended("base64", STANDARD.encode(&counted).as_bytes())),
        ),
    ];
    all.into_iter()
        .map(|(name, path, bytes)| Sample { name, files: vec![(path, bytes)], options: "", map, tolerance })
        .collect()
}

/// Options of a sample with its placement filled in.
pub fn options(sample: &Sample) -> Vec<String> {
    let rows: Vec<String> = (0..12).map(|i| format!("{:?}", sample.map.row(i / 4)[i % 4])).collect();
    sample.options.split_whitespace().map(|word| word.replace('@', &rows.join(","))).collect()
}
