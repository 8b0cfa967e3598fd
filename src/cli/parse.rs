//! Option values that several commands share.

use crate::math::Aabb;
use crate::scene::camera::Window;
use glam::DVec3;

/// Parses a finite number.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    text.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| format!("'{text}' is not a finite number"))
}

/// Parses a finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err(format!("'{text}' must be above zero")) })
}

/// Parses a finite number that is not negative.
pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v >= 0.0 { Ok(v) } else { Err(format!("'{text}' must not be negative")) })
}

/// Parses a probability above 0 and below 1.
pub(crate) fn probability(text: &str) -> Result<f64, String> {
    let holds = |v: f64| if v > 0.0 && v < 1.0 { Ok(v) } else { Err(format!("'{text}' must be above 0 and below 1")) };
    number(text).and_then(holds)
}

/// Parses a time above zero into seconds: a number of them, or numbers with units such as 1h30m.
pub(crate) fn duration(text: &str) -> Result<f64, String> {
    if text.parse::<f64>().is_ok() {
        return positive(text);
    }
    let seconds =
        humantime::parse_duration(text).map_err(|e| format!("'{text}' is no time such as 60s or 1h30m: {e}"))?;
    positive(&seconds.as_secs_f64().to_string())
}

/// Parses a whole number, or the first and the last of some: `3`, `0-7`.
pub(crate) fn range(text: &str) -> Result<[u32; 2], String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    match (first.parse(), last.parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok([first, last]),
        _ => Err(format!("'{text}' is no number such as 3, and no range such as 0-7")),
    }
}

/// Parses an exposure in stops, from -60 to 60: beyond, every float is black or white.
pub(crate) fn exposure(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v.abs() <= 60.0 { Ok(v) } else { Err(format!("'{text}' must be from -60 to 60")) })
}

/// Parses a number from 0 to 1, 1 excluded.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    not_negative(text).and_then(|v| if v < 1.0 { Ok(v) } else { Err(format!("'{text}' must be below 1")) })
}

/// Smallest angle of view in degrees: below it, pixels are finer than the precision that cameras are placed with.
const SMALLEST_ANGLE: f64 = 1e-3;
/// Largest radiance of a color option: its square is still finite in single precision.
const BRIGHTEST: f64 = 1e15;

/// Parses an angle of view in degrees, from 0.001 to 170, 170 excluded.
pub(crate) fn angle(text: &str) -> Result<f64, String> {
    let degrees = positive(text)?;
    if degrees < SMALLEST_ANGLE {
        return Err(format!("'{text}' is too small an angle; give {SMALLEST_ANGLE} to 170 degrees"));
    }
    if degrees < 170.0 { Ok(degrees) } else { Err(format!("'{text}' must be below 170 degrees")) }
}

/// Parses two ascending numbers, `low,high`.
pub(crate) fn ascending(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
    match numbers[..] {
        [low, high] if low < high && (high - low).is_finite() => Ok([low, high]),
        [low, high] => Err(format!("{low} and {high} do not ascend")),
        _ => Err(format!("{} numbers, two are needed: low,high", numbers.len())),
    }
}

/// Parses a world-space box, `x0,y0,z0,x1,y1,z1`.
pub(crate) fn corners(text: &str) -> Result<Aabb, String> {
    let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
    let [x0, y0, z0, x1, y1, z1] = numbers[..] else {
        return Err(format!("{} numbers, six are needed: x0,y0,z0,x1,y1,z1", numbers.len()));
    };
    let box_ = Aabb { min: DVec3::new(x0, y0, z0), max: DVec3::new(x1, y1, z1) };
    if box_.is_empty() { Err("the first corner must not exceed the second".into()) } else { Ok(box_) }
}

/// Parses a picture's size, `WxH` in pixels, each from 1 to 65536.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.trim().parse::<u32>().ok().filter(|n| (1..=65_536).contains(n));
    text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?])).ok_or_else(|| {
        format!("'{text}' is no size; give WIDTHxHEIGHT in pixels, each from 1 to 65536, such as 256x256")
    })
}

/// Parses a part of a picture: `x0,y0,x1,y1`, whose last column and row are no part of it, or `x,y,WIDTHxHEIGHT`.
pub(crate) fn window(text: &str) -> Result<Window, String> {
    let place = |text: &str| text.trim().parse::<u32>().map_err(|_| format!("'{text}' is no column or row of pixels"));
    match text.split(',').collect::<Vec<_>>()[..] {
        [x, y, extent] => Ok(Window { origin: [place(x)?, place(y)?], size: size(extent)? }),
        [x0, y0, x1, y1] => {
            let [x0, y0, x1, y1] = [place(x0)?, place(y0)?, place(x1)?, place(y1)?];
            match (x1.checked_sub(x0), y1.checked_sub(y0)) {
                (Some(w @ 1..), Some(h @ 1..)) => Ok(Window { origin: [x0, y0], size: [w, h] }),
                _ => Err(format!("'{text}' holds no pixel: x1 and y1 must be greater than x0 and y0")),
            }
        }
        _ => Err(format!(
            "'{text}' is no part of a picture; give x0,y0,x1,y1 such as 64,32,192,160, or column,row,WIDTHxHEIGHT such \
             as 64,32,128x128"
        )),
    }
}

/// Parses a scene-linear color, `r,g,b` or one number for grey, each from 0 to 1e15.
pub(crate) fn color(text: &str) -> Result<[f32; 3], String> {
    let numbers = text.split(',').map(not_negative).collect::<Result<Vec<_>, _>>()?;
    if numbers.iter().any(|v| *v > BRIGHTEST) {
        return Err(format!("'{text}' is brighter than {BRIGHTEST:e}, the most that a radiance may be"));
    }
    match numbers[..] {
        [grey] => Ok([grey as f32; 3]),
        [r, g, b] => Ok([r as f32, g as f32, b as f32]),
        _ => Err(format!("{} numbers; one (grey) or three (r,g,b) are needed", numbers.len())),
    }
}

/// Parses a position, `x,y,z`.
pub(crate) fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
    numbers.try_into().map_err(|other: Vec<f64>| format!("{} numbers, three are needed: x,y,z", other.len()))
}

/// Parses a vector, `x,y,z`, whose direction can be computed: neither zero nor so small or large that its square is not
/// held.
pub(crate) fn vector(text: &str) -> Result<DVec3, String> {
    let vector = DVec3::from(point(text)?);
    if vector.normalize().is_normalized() { Ok(vector) } else { Err(format!("'{text}' has no direction")) }
}

/// Parses an albedo, `r,g,b` or one number for grey, each from 0 to 1.
pub(crate) fn albedo(text: &str) -> Result<[f32; 3], String> {
    let color = color(text)?;
    if color.iter().all(|v| *v <= 1.0) {
        Ok(color)
    } else {
        Err(format!("'{text}' would scatter more than arrives; give 0 to 1"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_read_and_what_not() {
        assert_eq!(size("640x480").unwrap(), [640, 480]);
        let part = window("64,32,128x96").unwrap();
        assert!(window("64,32,192,128").unwrap() == part && window("4,4,4,9").is_err() && window("1,2").is_err());
        assert!(size("640").is_err() && size("0x4").is_err() && size("4x70000").is_err());
        assert_eq!(color("0.5").unwrap(), [0.5; 3]);
        assert_eq!(color("1, 0,0.25").unwrap(), [1.0, 0.0, 0.25]);
        assert!(
            color("1e308").is_err() && color("0,0,1e30").is_err() && angle("1e-300").is_err() && angle("0.5").is_ok()
        );
        assert!(color("1,2").is_err() && color("-1").is_err() && color("nan").is_err());
        assert!(corners("0,0,0,1,1").is_err() && corners("0,0,0,-1,1,1").is_err() && corners("0,0,0,1,1,1").is_ok());
        assert_eq!(ascending("-1, 2.5").unwrap(), [-1.0, 2.5]);
        assert!(ascending("1,1").is_err() && ascending("1").is_err() && ascending("0,inf").is_err());
        assert!(positive("0").is_err() && positive("inf").is_err() && not_negative("0").is_ok());
        assert_eq!(vector("0,-1, 2"), Ok(DVec3::new(0.0, -1.0, 2.0)));
        assert!(vector("0,0,0").is_err() && vector("1e200,0,0").is_err() && vector("1,2").is_err());
        assert!(albedo("0.9").is_ok() && albedo("1,0,1.01").is_err());
        assert!(share("0").is_ok() && share("0.5").is_ok() && share("1").is_err() && share("-0.1").is_err());
    }
}
