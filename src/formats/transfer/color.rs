//! Color interpolation between two knots, as VTK's color functions define it: display-referred sRGB in and out.
//!
//! Lab is CIE 1976 L*a*b* with VTK's white point (0.9505, 1, 1.089). Diverging is Moreland, "Diverging Color Maps for
//! Scientific Visualization" (ISVC 2009): its polar form of Lab, with white between two saturated colors of different
//! hue.

use crate::error::{Error, Result};
use std::f64::consts::{PI, TAU};

type Rgb = [f64; 3];

/// Color space in which colors are interpolated between two knots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Space {
    /// Linear interpolation of display-referred red, green and blue.
    Rgb,
    /// Linear interpolation of hue, saturation and value; `wrap` takes the shorter arc between the hues.
    Hsv { wrap: bool },
    /// Linear interpolation of L*a*b*.
    Lab,
    /// Linear interpolation in Moreland's polar Lab.
    Diverging,
    /// Constant interpolation with the upper knot's color.
    Step,
}

impl Space {
    /// The color space of this name in ParaView.
    ///
    /// # Errors
    /// If the name is none of those supported.
    pub(crate) fn named(name: &str, wrap: bool) -> Result<Self> {
        match name {
            "RGB" => Ok(Self::Rgb),
            "HSV" => Ok(Self::Hsv { wrap }),
            "Wrapped" => Ok(Self::Hsv { wrap: true }),
            "Lab" | "LAB" | "CIELAB" => Ok(Self::Lab),
            "Diverging" => Ok(Self::Diverging),
            "Step" => Ok(Self::Step),
            _ => Err(Error::unsupported(format!(
                "color space '{name}'; RGB, HSV, Wrapped, Lab, Diverging or Step is expected"
            ))
            .hint("choose one of these in ParaView's color map editor, and export the preset again")),
        }
    }

    /// Color at `s`, from 0 to 1, between two colors. Except for [`Space::Step`], the ends are the two colors to the
    /// last bit, so that neighbouring pieces meet.
    pub(crate) fn between(self, s: f64, from: Rgb, to: Rgb) -> Rgb {
        if self == Self::Step || s >= 1.0 {
            return to;
        }
        if s <= 0.0 || from == to {
            return from;
        }
        match self {
            Self::Rgb | Self::Step => mix(s, from, to),
            Self::Hsv { wrap } => {
                let (a, b) = hues(from, to, wrap);
                rgb_of_hsv(mix(s, a, b))
            }
            Self::Lab => rgb_of_lab(mix(s, lab_of_rgb(from), lab_of_rgb(to))),
            Self::Diverging => between_msh(s, from, to),
        }
    }
}

impl Space {
    /// Positions between two colors, from 0 to 1, at which the interpolation has kinks, apart from those at the
    /// display's limits.
    pub(crate) fn kinks(self, from: Rgb, to: Rgb) -> Vec<f64> {
        match self {
            Self::Rgb | Self::Lab | Self::Step => Vec::new(),
            // White may lie in the middle.
            Self::Diverging => vec![0.5],
            Self::Hsv { wrap } => {
                // The ramp of a channel begins or ends at every sixth of the circle.
                let (a, b) = hues(from, to, wrap);
                let sixths = (-6..=6).map(|k| f64::from(k) / 6.0);
                sixths.map(|hue| (hue - a[0]) / (b[0] - a[0])).filter(|s| *s > 0.0 && *s < 1.0).collect()
            }
        }
    }
}

fn mix(s: f64, from: Rgb, to: Rgb) -> Rgb {
    std::array::from_fn(|c| (1.0 - s) * from[c] + s * to[c])
}

/// Converts a display-referred value to a scene-linear one (IEC 61966-2-1).
pub(super) fn linear(v: f64) -> f64 {
    if v > 0.040_45 { ((v + 0.055) / 1.055).powf(2.4) } else { v / 12.92 }
}

/// Converts a scene-linear value to a display-referred one.
fn display(v: f64) -> f64 {
    if v > 0.003_130_8 { 1.055 * v.powf(1.0 / 2.4) - 0.055 } else { 12.92 * v }
}

/// Converts RGB to hue from 0 to 1 (0 for greys), saturation and value.
fn hsv_of_rgb([r, g, b]: Rgb) -> Rgb {
    let (low, high) = (r.min(g).min(b), r.max(g).max(b));
    let range = high - low;
    if range == 0.0 {
        return [0.0, 0.0, high];
    }
    let sixth = if high == r {
        (g - b) / range
    } else if high == g {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    [(sixth / 6.0).rem_euclid(1.0), range / high, high]
}

/// Converts hue, saturation and value to RGB.
pub(super) fn rgb_of_hsv([hue, saturation, value]: Rgb) -> Rgb {
    // Each channel is full for a third of the circle around its own hue, and ramps for a sixth on either side.
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|own| {
        let distance = (hue - own + 0.5).rem_euclid(1.0) - 0.5;
        let share = (2.0 - 6.0 * distance.abs()).clamp(0.0, 1.0);
        value * (1.0 - saturation * (1.0 - share))
    })
}

/// Hue, saturation and value of both colors. With `wrap`, hues are shifted so that linear interpolation takes the
/// shorter arc.
fn hues(from: Rgb, to: Rgb, wrap: bool) -> (Rgb, Rgb) {
    let (mut a, mut b) = (hsv_of_rgb(from), hsv_of_rgb(to));
    if wrap && (a[0] - b[0]).abs() > 0.5 {
        if a[0] > b[0] { a[0] -= 1.0 } else { b[0] -= 1.0 }
    }
    (a, b)
}

/// White point of VTK's Lab.
const WHITE: Rgb = [0.9505, 1.0, 1.089];

fn lab_of_rgb(rgb: Rgb) -> Rgb {
    let [r, g, b] = rgb.map(linear);
    let xyz = [
        0.4124 * r + 0.3576 * g + 0.1805 * b,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        0.0193 * r + 0.1192 * g + 0.9505 * b,
    ];
    let [x, y, z] = std::array::from_fn(|c| {
        let v = xyz[c] / WHITE[c];
        if v > 0.008_856 { v.cbrt() } else { 7.787 * v + 16.0 / 116.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Converts L*a*b* to display-referred RGB. Colors beyond the display's range are divided by their largest channel,
/// then clipped at zero.
fn rgb_of_lab([l, a, b]: Rgb) -> Rgb {
    let y = (l + 16.0) / 116.0;
    let roots = [y + a / 500.0, y, y - b / 200.0];
    let [x, y, z] = std::array::from_fn(|c| {
        let cube = roots[c].powi(3);
        WHITE[c] * if cube > 0.008_856 { cube } else { (roots[c] - 16.0 / 116.0) / 7.787 }
    });
    let rgb = [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ]
    .map(display);
    let high = rgb.iter().fold(1.0_f64, |m, v| m.max(*v));
    rgb.map(|v| (v / high).max(0.0))
}

/// Converts RGB to Moreland's polar Lab: magnitude, saturation angle and hue angle.
fn msh_of_rgb(rgb: Rgb) -> Rgb {
    let [l, a, b] = lab_of_rgb(rgb);
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { (l / m).clamp(-1.0, 1.0).acos() } else { 0.0 };
    [m, s, if s > 0.001 { b.atan2(a) } else { 0.0 }]
}

fn between_msh(s: f64, from: Rgb, to: Rgb) -> Rgb {
    // Below this saturation angle a color counts as grey, whose hue is undefined.
    const GREY: f64 = 0.05;
    let (mut a, mut b, mut s) = (msh_of_rgb(from), msh_of_rgb(to), s);
    let apart = {
        let d = (a[2] - b[2]).abs() % TAU;
        d.min(TAU - d)
    };
    if a[1] > GREY && b[1] > GREY && apart > 0.33 * PI {
        let white = [a[0].max(b[0]).max(88.0), 0.0, 0.0];
        if s < 0.5 {
            (b, s) = (white, 2.0 * s);
        } else {
            (a, s) = (white, 2.0 * s - 1.0);
        }
    }
    if a[1] < GREY && b[1] > GREY {
        a[2] = spun_hue(b, a[0]);
    } else if b[1] < GREY && a[1] > GREY {
        b[2] = spun_hue(a, b[0]);
    } else if (a[2] - b[2]).abs() > PI {
        // Hues are a circle, of which the shorter arc is taken.
        if a[2] > b[2] { a[2] -= TAU } else { b[2] -= TAU }
    }
    let [m, s, h] = mix(s, a, b);
    rgb_of_lab([m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()])
}

/// Hue that a grey of magnitude `grey` is given next to a color, so that the perceived change is uniform (Moreland's
/// `adjustHue`).
fn spun_hue([m, s, h]: Rgb, grey: f64) -> f64 {
    if m >= grey - 0.1 {
        return h;
    }
    let spin = s * (grey * grey - m * m).sqrt() / (m * s.sin());
    if h > -0.3 * PI { h + spin } else { h - spin }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COOL: Rgb = [0.231_37, 0.298_039, 0.752_94];
    const WARM: Rgb = [0.705_882, 0.015_686_3, 0.149_02];

    /// Expected values are those of VTK 9.7.2's `vtkColorTransferFunction::GetColor`, rounded to seven digits.
    #[test]
    fn colors_are_those_of_vtk() {
        let hsv = Space::Hsv { wrap: false };
        let dark: [Rgb; 2] = [[0.0, 0.0, 0.02], [0.0, 1.0, 1.0]];
        let (white, green): (Rgb, Rgb) = ([1.0; 3], [0.2, 0.4, 0.1]);
        let viridis: [Rgb; 2] = [[0.267, 0.005, 0.329], [0.28, 0.14, 0.46]];
        let teal: [Rgb; 2] = [[0.1, 0.7, 0.5], [0.1, 0.5, 0.7]];
        for (space, from, to, s, expected) in [
            (Space::Lab, COOL, WARM, 0.3, [0.494_626_4, 0.243_550_4, 0.564_283]),
            (Space::Lab, COOL, WARM, 0.9, [0.686_924_6, 0.082_290_7, 0.208_762_2]),
            (Space::Lab, dark[0], dark[1], 0.1, [0.065_294_7, 0.108_606_4, 0.117_482_5]),
            (Space::Lab, dark[0], dark[1], 0.7, [0.138_722_6, 0.671_599_8, 0.675_138_5]),
            (hsv, COOL, WARM, 0.1, [0.244_016_5, 0.208_594_3, 0.748_234_2]),
            (hsv, COOL, WARM, 0.7, [0.719_999_4, 0.077_574_3, 0.574_538_2]),
            (Space::Diverging, COOL, WARM, 0.1, [0.351_731_8, 0.468_505_6, 0.890_374_6]),
            (Space::Diverging, COOL, WARM, 0.5, [0.865_395_2, 0.865_410_2, 0.865_395_6]),
            (Space::Diverging, COOL, WARM, 0.7, [0.969_771_5, 0.677_435_6, 0.559_709]),
            (Space::Diverging, white, green, 0.3, [0.608_842_4, 0.886_134_6, 0.863_781_1]),
            (Space::Diverging, viridis[0], viridis[1], 0.5, [0.276_370_2, 0.078_929, 0.393_889_2]),
            (Space::Diverging, teal[0], teal[1], 0.9, [0.230_946_1, 0.595_186_8, 0.749_269_5]),
            (Space::Step, COOL, WARM, 0.1, WARM),
        ] {
            let got = space.between(s, from, to);
            // Half of the last digit, and the effect of rounding in another order.
            let off = (0..3).map(|c| (got[c] - expected[c]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-7, "{space:?} at {s}: {got:?}, {expected:?}");
        }
    }

    #[test]
    fn hues_go_the_shorter_way_only_where_they_wrap() {
        let (red, magenta) = ([1.0, 0.1, 0.0], [1.0, 0.0, 0.1]);
        assert!(Space::Hsv { wrap: true }.between(0.5, red, magenta)[1] < 0.01, "through red");
        let long = Space::Hsv { wrap: false }.between(0.5, red, magenta);
        assert!(long[0] < 0.01 && long[1] > 0.9 && long[2] > 0.9, "through cyan: {long:?}");
    }

    #[test]
    fn ends_are_kept_to_the_bit() {
        for space in [Space::Rgb, Space::Hsv { wrap: true }, Space::Lab, Space::Diverging] {
            assert_eq!((space.between(0.0, COOL, WARM), space.between(1.0, COOL, WARM)), (COOL, WARM));
        }
    }

    #[test]
    fn every_mixture_can_be_shown() {
        let values = [0.0, 1e-9, 0.02, 0.5, 1.0];
        let all: Vec<Rgb> = (0..125).map(|i| [values[i % 5], values[i / 5 % 5], values[i / 25]]).collect();
        for space in [Space::Rgb, Space::Hsv { wrap: true }, Space::Hsv { wrap: false }, Space::Lab, Space::Diverging] {
            for from in &all {
                for to in &all {
                    for s in [0.25, 0.5, 0.9] {
                        let got = space.between(s, *from, *to);
                        assert!(
                            got.iter().all(|v| (0.0..=1.0 + 1e-12).contains(v)),
                            "{space:?} {from:?} {to:?} {s}: {got:?}"
                        );
                    }
                }
            }
        }
    }
}
