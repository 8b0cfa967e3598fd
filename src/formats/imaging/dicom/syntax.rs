//! Transfer syntaxes: how elements are coded, and how pixels are packed.

use crate::error::{Error, Result};

/// How the pixels of a frame are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As they are.
    Plain,
    /// Runs of bytes, a stream for each byte of a pixel.
    Rle,
    /// JPEG of 8 bits, or lossless JPEG.
    Jpeg,
    /// JPEG 2000, a codestream for each frame.
    Jpeg2000,
}

/// Coding of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Syntax {
    /// True if every element states its type.
    pub explicit: bool,
    /// True if numbers have their most significant byte first.
    pub big: bool,
    /// True if the whole data set is a stream of deflate.
    pub deflated: bool,
    /// Packing of the pixels.
    pub packing: Packing,
}

/// Coding of the file's meta information.
pub(crate) const META: Syntax = Syntax { explicit: true, big: false, deflated: false, packing: Packing::Plain };

/// Transfer syntax of a UID.
///
/// # Errors
/// If it is not read; the error names it and what to do.
pub(crate) fn of_uid(uid: &str) -> Result<Syntax> {
    let Some(of) = uid.strip_prefix("1.2.840.10008.1.2") else { return Err(unread(uid, "an unknown transfer syntax")) };
    Ok(match of {
        "" => Syntax { explicit: false, ..META },
        ".1" => META,
        ".1.99" => Syntax { deflated: true, ..META },
        ".2" => Syntax { big: true, ..META },
        ".5" => Syntax { packing: Packing::Rle, ..META },
        ".4.50" | ".4.51" | ".4.57" | ".4.70" => Syntax { packing: Packing::Jpeg, ..META },
        ".4.80" | ".4.81" => return Err(unread(uid, "JPEG-LS")),
        ".4.90" | ".4.91" => Syntax { packing: Packing::Jpeg2000, ..META },
        ".4.92" | ".4.93" => return Err(unread(uid, "JPEG 2000 of several components")),
        ".4.110" | ".4.111" | ".4.112" => return Err(unread(uid, "JPEG XL")),
        ".4.201" | ".4.202" | ".4.203" => return Err(unread(uid, "HTJ2K")),
        _ => return Err(unread(uid, "a transfer syntax that is not read")),
    })
}

fn unread(uid: &str, name: &str) -> Error {
    Error::unsupported(format!("the pixels are packed by {name} (transfer syntax {uid}), which is not read"))
        .hint("unpack the files first: gdcmconv --raw IN OUT, or dcmconv of DCMTK")
}
