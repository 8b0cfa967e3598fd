//! Numbers formatted for people.

/// Formats a number with three significant digits, without an exponent for magnitudes from 1e-3 to 1e6.
pub(crate) fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() || !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = (2 - size.log10().floor() as i32).max(0) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn three_digits_are_kept() {
        let shown: Vec<_> = [0.0, 0.012_345, 1.0, 99.94, 1234.5, -0.5, 1.234e-7, 2e9].map(short).to_vec();
        assert_eq!(shown, ["0", "0.0123", "1.00", "99.9", "1234", "-0.500", "1.23e-7", "2.00e9"].map(String::from));
        assert_eq!(short(f64::INFINITY), "inf");
    }
}
