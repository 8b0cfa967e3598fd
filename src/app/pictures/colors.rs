//! Meaning of a transfer function's colors in pictures of scattered light.

use crate::error::Result;
use crate::formats::transfer::Function;
use crate::scene::albedo::{AlbedoFunction, TransferColor};
use std::sync::Arc;

/// Meaning of the colors of a transfer function in a medium that scatters light.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::app) struct Colors {
    /// Meaning of the colors.
    pub color: TransferColor,
    /// True if the settings state it.
    stated: bool,
    /// Albedo that the function states beside its colors.
    pub own: Option<Arc<AlbedoFunction>>,
}

impl Colors {
    /// Returns the meaning of the colors of a function: that which is `stated`, else the usual one.
    ///
    /// # Errors
    /// If the function cannot be used.
    pub(crate) fn of(function: &Function, stated: Option<TransferColor>) -> Result<Self> {
        let color = stated.map_or_else(|| function.usual_color(), Ok)?;
        Ok(Self { color, stated: stated.is_some(), own: function.albedo.clone() })
    }

    /// Says what the colors were taken for, where no setting states it.
    pub(crate) fn remark(&self) -> Option<String> {
        if self.stated {
            return None;
        }
        let taken = match (self.color, &self.own) {
            (TransferColor::Albedo, _) => {
                "the colors of the transfer function are its albedo, as all lie within 0 to 1, and nothing is emitted"
            }
            (TransferColor::Emission, _) => {
                "the colors of the transfer function are emission, since some lie above 1, and the albedo is the same \
                 for all densities"
            }
            (TransferColor::Both, Some(_)) => "the transfer function states its albedo, and its colors are emission",
            (TransferColor::Both, None) => "the colors of the transfer function are its albedo and emission",
        };
        Some(format!("{taken}: ⟨tf_color⟩ states it otherwise"))
    }
}
