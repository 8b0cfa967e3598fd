//! The function `ln(1 + e^u)`, by which an unknown that may be any number stands for a positive one.

/// Returns `ln(1 + e^u)` and its derivative, without overflow.
pub(crate) fn value(u: f64) -> [f64; 2] {
    [u.max(0.0) + (-u.abs()).exp().ln_1p(), 1.0 / (1.0 + (-u).exp())]
}

/// Returns the number of which `y` is the function, `ln(e^y - 1)`, without overflow and cancellation.
pub(crate) fn inverse(y: f64) -> f64 {
    y + (-(-y).exp_m1()).ln()
}
