//! Interface to the C shim: generated declarations, and one function that turns a status into a result.

#[allow(missing_docs, dead_code, non_camel_case_types, unreachable_pub, unused_qualifications, clippy::all)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/vdb_ffi.rs"));
}

use generated::{CUMULO_VDB_IO, CUMULO_VDB_OK, CUMULO_VDB_OUT_OF_MEMORY, CUMULO_VDB_UNSUPPORTED, cumulo_vdb_status};
pub(super) use generated::{
    cumulo_vdb_file_grid as file_grid, cumulo_vdb_file_meta as file_meta, cumulo_vdb_grid as RawGrid,
    cumulo_vdb_grid_add_tile as grid_add_tile, cumulo_vdb_grid_component as grid_component,
    cumulo_vdb_grid_crop as grid_crop, cumulo_vdb_grid_empty as grid_empty, cumulo_vdb_grid_free as grid_free,
    cumulo_vdb_grid_from_polygons as grid_from_polygons, cumulo_vdb_grid_info as grid_info,
    cumulo_vdb_grid_mend_meta as grid_mend_meta, cumulo_vdb_grid_merge as grid_merge,
    cumulo_vdb_grid_meta as grid_meta, cumulo_vdb_grid_new as grid_new, cumulo_vdb_grid_prune as grid_prune,
    cumulo_vdb_grid_read_box as grid_read_box, cumulo_vdb_grid_repair as grid_repair,
    cumulo_vdb_grid_resample as grid_resample, cumulo_vdb_grid_resample_box as grid_resample_box,
    cumulo_vdb_grid_same as grid_same, cumulo_vdb_grid_set_class as grid_set_class,
    cumulo_vdb_grid_set_half as grid_set_half, cumulo_vdb_grid_set_matrix as grid_set_matrix,
    cumulo_vdb_grid_set_name as grid_set_name, cumulo_vdb_grid_to_fog as grid_to_fog,
    cumulo_vdb_grid_to_level_set as grid_to_level_set, cumulo_vdb_grid_turn_vectors as grid_turn_vectors,
    cumulo_vdb_grid_write_box as grid_write_box, cumulo_vdb_info as Info, cumulo_vdb_layout as RawLayout,
    cumulo_vdb_leaf as RawPlaces, cumulo_vdb_leaves as RawLeaves, cumulo_vdb_leaves_copy as leaves_copy,
    cumulo_vdb_leaves_count as leaves_count, cumulo_vdb_leaves_free as leaves_free,
    cumulo_vdb_leaves_new as leaves_new, cumulo_vdb_load_begin as load_begin, cumulo_vdb_load_end as load_end,
    cumulo_vdb_load_leaves as load_leaves, cumulo_vdb_load_values as load_values, cumulo_vdb_loading as RawLoading,
    cumulo_vdb_meta as RawMeta, cumulo_vdb_meta_count as meta_count, cumulo_vdb_meta_entry as MetaEntry,
    cumulo_vdb_meta_free as meta_free, cumulo_vdb_meta_get as meta_get, cumulo_vdb_meta_new as meta_new,
    cumulo_vdb_meta_set as meta_set, cumulo_vdb_on_terminate as on_terminate, cumulo_vdb_polygons as Polygons,
    cumulo_vdb_surface as RawSurface, cumulo_vdb_surface_copy as surface_copy,
    cumulo_vdb_surface_count as surface_count, cumulo_vdb_surface_counts as SurfaceCounts,
    cumulo_vdb_surface_free as surface_free, cumulo_vdb_surface_new as surface_new, cumulo_vdb_tile as RawTile,
    cumulo_vdb_tiles as tiles, cumulo_vdb_touch as touch, cumulo_vdb_version as version, cumulo_vdb_write as write,
};

use crate::error::{Code, Error, Result};
use std::ffi::{CString, c_char};

/// Calls one function of the shim and turns its status into a result.
pub(super) fn call(entry: impl FnOnce(*mut cumulo_vdb_status) -> i32) -> Result<()> {
    let mut status = cumulo_vdb_status { code: 0, os_error: 0, message: [0; 504] };
    let code = entry(&mut status);
    if code == CUMULO_VDB_OK as i32 {
        return Ok(());
    }
    let message = text(&status.message);
    if code == CUMULO_VDB_IO as i32 {
        return Err(Error::system(std::io::Error::from_raw_os_error(status.os_error)));
    }
    Err(if code == CUMULO_VDB_UNSUPPORTED as i32 {
        Error::unsupported(message).hint("choose other grids with ⟨grid⟩, or leave that edit out")
    } else if code == CUMULO_VDB_OUT_OF_MEMORY as i32 {
        Error::native("OpenVDB ran out of memory")
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted, or crop or resample it where it was made")
    } else {
        Error::native(format!("OpenVDB: {message}"))
    })
}

/// Text of a NUL-terminated string of any encoding. OpenVDB's messages can quote raw bytes of the file, so control
/// characters are replaced.
pub(super) fn text(chars: &[c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|c| *c as u8).take_while(|c| *c != 0).collect();
    printable(&bytes)
}

/// Text of bytes as lossy UTF-8; control characters other than tab and line feed are replaced.
pub(super) fn printable(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes)
        .chars()
        .map(|c| if c.is_control() && c != '\n' && c != '\t' { '\u{fffd}' } else { c })
        .collect()
}

/// Converts a name for C. A NUL byte in it is an error.
pub(super) fn c_name(name: &str) -> Result<CString> {
    CString::new(name)
        .map_err(|_| Error::invalid(format!("the name {name:?} contains a NUL byte")).hint("give another name"))
}

#[cfg(test)]
mod tests {
    /// The documentation is built from declarations that are kept: after a change of the header, copy the generated
    /// ones over them.
    #[test]
    fn declarations_that_are_kept_are_those_of_the_header() {
        let generated = include_str!(concat!(env!("OUT_DIR"), "/vdb_ffi.rs"));
        assert!(
            generated == include_str!("bindings.rs"),
            "copy {}/vdb_ffi.rs to src/formats/vdb/bindings.rs",
            env!("OUT_DIR")
        );
    }
}
