//! Stages for the tests: text, binaries and packages in a folder of their own.

use cumulo::error::Result;
use cumulo::formats::limits::Limits;
use cumulo::formats::usd::Stage;
use openusd::{usda, usdc};
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder of stages.
pub struct Stages(TempDir);

impl Stages {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a layer; the magic line is added to text.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, format!("#usda 1.0\n{text}")).unwrap();
        path
    }

    pub fn open(&self, text: &str) -> Stage {
        open(&self.write("stage.usda", text)).unwrap()
    }
}

pub fn open(path: &Path) -> Result<Stage> {
    Stage::open(path, Limits::default())
}

/// The bytes of a binary layer.
pub fn binary(text: &str) -> Vec<u8> {
    let data = usda::parse(&format!("#usda 1.0\n{text}")).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    usdc::CrateWriter::write(&data, &mut bytes).unwrap();
    bytes.into_inner()
}

/// The bytes of a package, whose files are stored as they are.
pub fn package(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default());
    for (name, bytes) in files {
        writer.start_file(*name, options).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}
