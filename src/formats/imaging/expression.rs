//! An expression of a value, such as `max(v - 0.1, 0) * 2`.

use crate::error::{Code, Error, Result};
use exmex::{BinOp, ExResult, Express, FlatEx, FloatOpsFactory, MakeOperators, Operator};

/// Longest expression, in bytes: parsing goes as deep as its parentheses.
const LONGEST: usize = 1000;

/// Name of the value.
const VALUE: &str = "v";

/// The operators of numbers, and comparisons, which are 1 where they hold and else 0.
#[derive(Debug, Clone)]
struct Operators;

impl MakeOperators<f64> for Operators {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        // After sums and all else.
        let of = |repr, apply| Operator::make_bin(repr, BinOp { apply, prio: -1, is_commutative: false });
        let comparisons = [
            of("<", |a, b| f64::from(u8::from(a < b))),
            of("<=", |a, b| f64::from(u8::from(a <= b))),
            of(">", |a, b| f64::from(u8::from(a > b))),
            of(">=", |a, b| f64::from(u8::from(a >= b))),
            of("==", |a, b| f64::from(u8::from(a == b))),
            of("!=", |a, b| f64::from(u8::from(a != b))),
        ];
        FloatOpsFactory::make().into_iter().chain(comparisons).collect()
    }
}

/// An expression of one variable, `v`.
#[derive(Debug, Clone)]
pub struct Expression {
    text: String,
    parsed: FlatEx<f64, Operators>,
    /// True if the value occurs in it.
    varies: bool,
}

impl PartialEq for Expression {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

impl Expression {
    /// Reads an expression of numbers, `v`, `+ - * / ^`, comparisons, parentheses, and functions such as `min(a, b)`,
    /// `sqrt` and `exp`.
    ///
    /// # Errors
    /// If it is no such expression; the error says where it ceases to be.
    pub fn parse(text: &str) -> Result<Self> {
        let refused = |why: String| {
            Error::invalid(format!("⟨eval={text}⟩: {why}"))
                .coded(Code::Usage)
                .hint("give an expression of the value v, such as `max(v - 0.1, 0) * 2` or `v * (v > 0.5)`")
        };
        if text.len() > LONGEST {
            return Err(refused(format!("an expression has {LONGEST} bytes at most")));
        }
        let parsed: ExResult<FlatEx<f64, Operators>> = FlatEx::parse(text);
        let parsed = parsed.map_err(|e| refused(e.msg().to_owned()))?;
        let varies = match parsed.var_names() {
            [] => false,
            [only] if only == VALUE => true,
            [name, ..] if name == VALUE => return Err(refused(format!("'{}' is unknown", parsed.var_names()[1]))),
            [name, ..] => return Err(refused(format!("'{name}' is unknown"))),
        };
        Ok(Self { text: text.to_owned(), parsed, varies })
    }

    /// Returns what the expression makes of a value.
    pub(crate) fn of(&self, value: f64) -> f64 {
        let variables: &[f64] = if self.varies { &[value] } else { &[] };
        // The number of variables is right, which is all that may be wrong.
        self.parsed.eval(variables).unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn expressions_are_those_of_arithmetic() {
        for (text, value, expected) in [
            ("v", 3.0, 3.0),
            ("max(v - 0.1, 0) * 2", 0.6, 1.0),
            ("max(v - 0.1, 0) * 2", 0.05, 0.0),
            ("v * (v > 0.5)", 0.5, 0.0),
            ("v * (v >= 0.5)", 0.5, 0.5),
            ("2 + v * 3 < 9", 2.0, 1.0),
            ("v == 2", 2.0, 1.0),
            ("v != 2", 2.0, 0.0),
            ("v / 2 * 3 - 1 + 4", 4.0, 9.0),
            ("sqrt(v) + exp(0) + min(1, abs(-2))", 9.0, 5.0),
            ("v^2", -3.0, 9.0),
            ("7", 1.0, 7.0),
            ("2e-3 * v", 1e3, 2.0),
        ] {
            assert!((Expression::parse(text).unwrap().of(value) - expected).abs() < 1e-12, "{text}");
        }
        assert!(Expression::parse("v").unwrap().of(f64::NAN).is_nan());
        for (text, named) in [("v + w", "'w'"), ("x * 2", "'x'"), ("v +", "v +"), ("", "eval"), ("(v", "(v")] {
            let error = Expression::parse(text).unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("such as"), "{error}");
        }
        assert!(Expression::parse(&"(".repeat(5000)).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// No text ends the program.
        #[test]
        fn any_text_is_an_expression_or_an_error(text in "[v0-9a-z+*/^()<>=!., eE-]{0,40}|.{0,40}") {
            if let Ok(expression) = Expression::parse(&text) {
                let _ = [expression.of(0.5), expression.of(f64::NAN)];
            }
        }

        #[test]
        fn deep_texts_end(depth in 1..1000_usize, part in "\\(|-|v\\^|sin\\(|v<") {
            let text = part.repeat(depth / part.len());
            let _ = [text.clone(), format!("{text}v")].map(|text| Expression::parse(&text).map(|e| e.of(1.0)));
        }
    }
}
