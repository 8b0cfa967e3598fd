//! Albedos by density: which color a medium has where light shines on it, as tissue or paint has.

use crate::error::{Error, Result};
use crate::scene::table::Table;

/// Meaning of the colors of a transfer function in a medium that scatters light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TransferColor {
    /// Radiance of the source, of which the share that is not scattered is emitted; all densities have one albedo.
    Emission,
    /// Albedo, times that of the medium; nothing is emitted.
    Albedo,
    /// Albedo, and radiance of the source at once: what is not scattered is emitted. A function that states an albedo
    /// of its own has that, and its colors are the source's.
    Both,
}

impl TransferColor {
    /// Every meaning.
    pub const ALL: [Self; 3] = [Self::Emission, Self::Albedo, Self::Both];

    /// Returns the name in files and settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Emission => "emission",
            Self::Albedo => "albedo",
            Self::Both => "both",
        }
    }

    /// Returns what the colors of a function are taken for unless it is stated: `own` tells whether it has an albedo of
    /// its own. Without one, colors from 0 to 1 are an albedo, and brighter ones can only be a radiance.
    pub fn usual(transfer: &Table, own: bool) -> Self {
        match transfer.peak() {
            _ if own => Self::Both,
            [r, g, b, _] if r.max(g).max(b) <= 1.0 => Self::Albedo,
            _ => Self::Emission,
        }
    }
}

/// Color of the albedo as a piecewise linear function of the density, from 0 to 1 in red, green and blue: the factor of
/// a medium's albedo. It is constant below the first point and above the last; two points at one density are a step, at
/// which it takes the upper point's color.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoFunction {
    /// Colors; extinctions are 0.
    table: Table,
}

impl AlbedoFunction {
    /// Creates the function of points of ascending density: density, then red, green and blue.
    ///
    /// # Errors
    /// If a color lies outside 0 to 1, or the points are none that [`Table::new`] takes.
    pub fn new(points: &[[f64; 4]]) -> Result<Self> {
        for [density, color @ ..] in points {
            if let Some(bad) = color.iter().find(|v| !(0.0..=1.0).contains(*v)) {
                return Err(Error::invalid(format!("at density {density} the albedo is {bad}: 0 to 1 is expected"))
                    .hint("the albedo is the share of the extinction that is scattered; more would make light"));
            }
        }
        let (knots, values) = points.iter().map(|[d, r, g, b]| (*d, [*r, *g, *b, 0.0])).unzip();
        Ok(Self { table: Table::new(knots, values)? })
    }

    /// Creates the function of the colors of a transfer function.
    ///
    /// # Errors
    /// If a color lies above 1.
    pub fn of_colors(transfer: &Table) -> Result<Self> {
        let points = transfer.knots().iter().zip(transfer.values()).map(|(d, [r, g, b, _])| [*d, *r, *g, *b]);
        Self::new(&points.collect::<Vec<_>>())
    }

    /// Returns the points: density, then red, green and blue.
    pub fn points(&self) -> Vec<[f64; 4]> {
        let all = self.table.knots().iter().zip(self.table.values());
        all.map(|(density, [r, g, b, _])| [*density, *r, *g, *b]).collect()
    }

    /// Returns the color at a density.
    pub fn at(&self, density: f64) -> [f64; 3] {
        let [r, g, b, _] = self.table.at(density);
        [r, g, b]
    }

    /// Returns the least and the greatest color over all densities, by channel.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let knots = self.table.knots();
        let (least, most) = self.table.bounds(knots[0], knots[knots.len() - 1]);
        [least, most].map(|[r, g, b, _]| [r, g, b])
    }

    /// Returns the colors as a table, with extinctions of 0.
    pub(crate) fn table(&self) -> &Table {
        &self.table
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::medium::{Medium, Source};
    use std::sync::Arc;

    #[test]
    fn colors_are_linear_between_points_and_bounded() {
        let points = [[0.0, 1.0, 0.0, 0.5], [0.5, 0.0, 1.0, 0.5], [0.5, 0.25, 0.25, 0.25]];
        let function = AlbedoFunction::new(&points).unwrap();
        assert_eq!((function.at(-1.0), function.at(0.25)), ([1.0, 0.0, 0.5], [0.5, 0.5, 0.5]));
        assert_eq!(function.at(0.5), [0.25; 3], "the upper side of a step");
        assert_eq!(function.bounds(), [[0.0, 0.0, 0.25], [1.0, 1.0, 0.5]]);
        assert_eq!(function.points(), points);
    }

    #[test]
    fn what_would_make_light_is_refused_with_density_and_value() {
        for bad in [1.5, -0.25, f64::NAN] {
            let error = AlbedoFunction::new(&[[0.0; 4], [0.75, 0.5, bad, 0.5]]).unwrap_err().to_string();
            assert!(error.contains("density 0.75") && error.contains(&bad.to_string()), "{error}");
        }
        let bright = Table::new(vec![0.0, 2.0], vec![[0.5, 0.5, 0.5, 9.0], [0.5, 3.0, 0.5, 9.0]]).unwrap();
        let error = AlbedoFunction::of_colors(&bright).unwrap_err().to_string();
        assert!(error.contains("density 2") && error.contains("albedo is 3"), "{error}");
        assert!(AlbedoFunction::new(&[]).is_err());
    }

    #[test]
    fn colors_mean_what_is_stated() {
        let table =
            |bright: f64| Table::new(vec![0.0, 1.0], vec![[0.5, 0.25, 0.0, 3.0], [bright, 0.5, 1.0, 4.0]]).unwrap();
        let of = |bright, own: Option<&Arc<AlbedoFunction>>, color| {
            Medium::absorbing(2.0).with_function(table(bright), own.cloned(), color)
        };
        let own = Arc::new(AlbedoFunction::new(&[[0.5, 0.1, 0.2, 0.3]]).unwrap());
        let colors = Some(Arc::new(AlbedoFunction::of_colors(&table(1.0)).unwrap()));
        let (bright, dark) =
            (Source::Transfer(Arc::new(table(1.0))), Source::Transfer(Arc::new(table(1.0).without_color())));
        for (own, color, expected) in [
            (None, TransferColor::Emission, (bright.clone(), None)),
            (None, TransferColor::Albedo, (dark.clone(), colors.clone())),
            (None, TransferColor::Both, (bright.clone(), colors)),
            (Some(&own), TransferColor::Emission, (bright.clone(), None)),
            (Some(&own), TransferColor::Albedo, (dark, Some(own.clone()))),
            (Some(&own), TransferColor::Both, (bright, Some(own.clone()))),
        ] {
            let medium = of(1.0, own, color).unwrap();
            assert_eq!((medium.source, medium.albedo_function), expected, "{color:?}");
        }
        assert!(of(1.5, None, TransferColor::Emission).is_ok() && of(1.5, Some(&own), TransferColor::Both).is_ok());
        for color in [TransferColor::Albedo, TransferColor::Both] {
            let error = of(1.5, None, color).unwrap_err().to_string();
            assert!(error.contains("density 1 ") && error.contains("1.5") && error.contains("tf_color"), "{error}");
        }
        let usual = |bright, own| TransferColor::usual(&table(bright), own);
        assert_eq!([usual(1.0, false), usual(1.5, false)], [TransferColor::Albedo, TransferColor::Emission]);
        assert_eq!(usual(1.5, true), TransferColor::Both);
    }
}
