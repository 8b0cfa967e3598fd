//! Arithmetic on the values of a voxel, as in `max(density, 0.1) * 2`.
//!
//! From what binds least: `||`, `&&`, comparisons, `+` and `-`, `*` and `/`, the signs `-`, `+` and `!`, `^`. Powers
//! group from the right, and `-x^2` is `-(x^2)`, as in mathematics. Comparisons and `!` give 1 or 0; 0 is false.

use crate::text::serde_as_text;
use std::fmt;
use std::str::FromStr;
use winnow::ascii::{float, multispace0};
use winnow::combinator::{Infix, Prefix, alt, cut_err, delimited, expression, opt, preceded, separated};
use winnow::error::{ContextError, ErrMode};
use winnow::prelude::*;
use winnow::token::{one_of, take_till, take_while};

/// Most brackets, signs and powers of an expression, each of which takes stack while it is parsed.
const MOST_NESTED: usize = 200;

/// An expression of named values.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    text: String,
    names: Vec<String>,
    root: Node,
}

/// A part of an expression.
#[derive(Debug, Clone, PartialEq)]
enum Node {
    Number(f64),
    Name(String),
    /// A value by the place of its name.
    Value(usize),
    One(One, Box<Node>),
    Two(Two, Box<[Node; 2]>),
    Three(Three, Box<[Node; 3]>),
}

/// Makes types of functions that are equal if their names are.
macro_rules! function {
    ($name:ident, $kind:ty) => {
        #[derive(Debug, Clone, Copy)]
        struct $name(&'static str, $kind);

        impl PartialEq for $name {
            fn eq(&self, other: &Self) -> bool {
                self.0 == other.0
            }
        }
    };
}
function!(One, fn(f64) -> f64);
function!(Two, fn(f64, f64) -> f64);
function!(Three, fn(f64, f64, f64) -> f64);

/// Functions of one number.
const ONE: [One; 15] = [
    One("abs", f64::abs),
    One("floor", f64::floor),
    One("ceil", f64::ceil),
    One("round", f64::round),
    One("exp", f64::exp),
    One("ln", f64::ln),
    One("log2", f64::log2),
    One("log10", f64::log10),
    One("sqrt", f64::sqrt),
    One("sin", f64::sin),
    One("cos", f64::cos),
    One("tan", f64::tan),
    One("asin", f64::asin),
    One("acos", f64::acos),
    One("atan", f64::atan),
];
/// Functions of two numbers.
const TWO: [Two; 4] = [Two("min", f64::min), Two("max", f64::max), Two("pow", f64::powf), Two("atan2", f64::atan2)];
/// Functions of three numbers.
const THREE: [Three; 4] = [
    Three("if", |condition, then, other| if is_true(condition) { then } else { other }),
    Three("clamp", |v, low, high| v.max(low).min(high)),
    Three("mix", |a, b, share| a + (b - a) * share),
    Three("smoothstep", |low, high, v| {
        let t = ((v - low) / (high - low)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }),
];

fn is_true(v: f64) -> bool {
    v != 0.0
}

impl Expression {
    /// Returns the names of the values, in the order in which [`Self::value`] expects them.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns the value of the expression for those of its names.
    pub(super) fn value(&self, values: &[f64]) -> f64 {
        self.root.value(values)
    }
}

impl Node {
    fn value(&self, values: &[f64]) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Value(place) => values[*place],
            Self::Name(_) => f64::NAN,
            Self::One(function, of) => function.1(of.value(values)),
            Self::Two(function, of) => function.1(of[0].value(values), of[1].value(values)),
            Self::Three(function, of) => function.1(of[0].value(values), of[1].value(values), of[2].value(values)),
        }
    }

    /// Replaces names by their places among those met so far.
    fn place(&mut self, names: &mut Vec<String>) {
        match self {
            Self::Name(name) => {
                let place = names.iter().position(|known| known == name).unwrap_or(names.len());
                if place == names.len() {
                    names.push(std::mem::take(name));
                }
                *self = Self::Value(place);
            }
            Self::Number(_) | Self::Value(_) => {}
            Self::One(_, of) => of.place(names),
            Self::Two(_, of) => of.iter_mut().for_each(|part| part.place(names)),
            Self::Three(_, of) => of.iter_mut().for_each(|part| part.place(names)),
        }
    }
}

impl FromStr for Expression {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let nested = text.bytes().filter(|byte| b"(+-!^".contains(byte)).count();
        if nested > MOST_NESTED {
            return Err(format!(
                "the expression has {nested} brackets, signs and powers; {MOST_NESTED} at most are parsed"
            ));
        }
        let parsed = delimited(multispace0, node, multispace0).parse(text).map_err(|e| {
            let (before, behind) = text.split_at(e.offset());
            if behind.trim().is_empty() {
                format!("'{text}' ends where a number, a name or a bracket is expected")
            } else {
                format!("'{text}' is no expression: '{behind}' does not fit behind '{before}'")
            }
        });
        let (mut root, mut names) = (parsed?, Vec::new());
        root.place(&mut names);
        Ok(Self { text: text.to_owned(), names, root })
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

serde_as_text!(Expression);

type Parsed<T> = Result<T, ErrMode<ContextError>>;

fn two(name: &'static str, function: fn(f64, f64) -> f64, a: Node, b: Node) -> Node {
    Node::Two(Two(name, function), Box::new([a, b]))
}

/// Parses all that operators join.
fn node(input: &mut &str) -> Parsed<Node> {
    /// An operator that groups from the left.
    macro_rules! left {
        ($power:literal, $name:literal, $function:expr) => {
            $name.value(Infix::Left($power, |_: &mut &str, a, b| Ok(two($name, $function, a, b))))
        };
    }
    fn truth(v: bool) -> f64 {
        f64::from(u8::from(v))
    }
    let infix = alt((
        alt((
            left!(1, "||", |a, b| truth(is_true(a) || is_true(b))),
            left!(2, "&&", |a, b| truth(is_true(a) && is_true(b))),
            left!(3, "<=", |a, b| truth(a <= b)),
            left!(3, ">=", |a, b| truth(a >= b)),
            left!(3, "==", |a, b| truth(a == b)),
            left!(3, "!=", |a, b| truth(a != b)),
            left!(3, "<", |a, b| truth(a < b)),
            left!(3, ">", |a, b| truth(a > b)),
        )),
        left!(5, "+", |a, b| a + b),
        left!(5, "-", |a, b| a - b),
        left!(7, "*", |a, b| a * b),
        left!(7, "/", |a, b| a / b),
        "^".value(Infix::Right(11, |_: &mut &str, a, b| Ok(two("^", f64::powf, a, b)))),
    ));
    let prefix = alt((
        '-'.value(Prefix(9, |_: &mut &str, a| Ok(Node::One(One("-", |v| -v), Box::new(a))))),
        '+'.value(Prefix(9, |_: &mut &str, a| Ok(a))),
        '!'.value(Prefix(9, |_: &mut &str, a| Ok(Node::One(One("!", |v| truth(!is_true(v))), Box::new(a))))),
    ));
    expression(delimited(multispace0, operand, multispace0))
        .prefix(preceded(multispace0, prefix))
        .infix(preceded(multispace0, infix))
        .parse_next(input)
}

fn operand(input: &mut &str) -> Parsed<Node> {
    let bracket = delimited('(', cut_err(node), cut_err(')'));
    let number = preceded(winnow::combinator::peek(one_of(('0'..='9', '.'))), float).map(Node::Number);
    let braced = delimited('{', take_till(1.., '}'), cut_err('}')).map(|name: &str| Node::Name(name.to_owned()));
    alt((bracket, number, braced, named)).parse_next(input)
}

/// Parses a function with its numbers, a constant or a name.
fn named(input: &mut &str) -> Parsed<Node> {
    let is_letter = |c: char| c.is_alphabetic() || c == '_';
    let mut name = (one_of(is_letter), take_while(0.., move |c| is_letter(c) || c.is_numeric() || c == '.')).take();
    let name: &str = name.parse_next(input)?;
    let start = *input;
    if opt(preceded(multispace0, '(')).parse_next(input)?.is_none() {
        return Ok(if name == "pi" { Node::Number(std::f64::consts::PI) } else { Node::Name(name.to_owned()) });
    }
    let of: Vec<Node> = cut_err(separated(1.., node, ',')).parse_next(input)?;
    cut_err(')').parse_next(input)?;
    let call = match <[Node; 1]>::try_from(of) {
        Ok([of]) => ONE.iter().find(|one| one.0 == name).map(|one| Node::One(*one, Box::new(of))),
        Err(of) => match <[Node; 2]>::try_from(of) {
            Ok(of) => TWO.iter().find(|two| two.0 == name).map(|two| Node::Two(*two, Box::new(of))),
            Err(of) => <[Node; 3]>::try_from(of).ok().and_then(|of| {
                THREE.iter().find(|three| three.0 == name).map(|three| Node::Three(*three, Box::new(of)))
            }),
        },
    };
    if call.is_none() {
        // What is wrong begins with the brackets.
        *input = start;
    }
    call.ok_or_else(|| ErrMode::Cut(ContextError::new()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        let expression: Expression = text.parse().unwrap();
        let values = |name: &String| match name.as_str() {
            "x" => 3.0,
            "density" => 0.25,
            "velocity.x" => -2.0,
            "density[1]" => 7.0,
            _ => panic!("{name}"),
        };
        expression.value(&expression.names().iter().map(values).collect::<Vec<_>>())
    }

    #[test]
    fn values_follow_the_rules_of_arithmetic() {
        for (text, expected) in [
            ("1/2", 0.5),
            ("2-3+4", 3.0),
            ("2 - 3 - 4", -5.0),
            ("2/3*6", 4.0),
            ("6/3/2", 1.0),
            ("2*3^2", 18.0),
            ("2^3^2", 512.0),
            ("-2^2", -4.0),
            ("(-2)^2", 4.0),
            ("2^-1", 0.5),
            ("-x^2 + x", -6.0),
            ("2 - -3", 5.0),
            ("-sqrt(4)^2", -4.0),
            ("1e-3 * 2", 0.002),
            (".5+1.", 1.5),
            ("max(min(x, 1), 0) * 2", 2.0),
            ("min(max(1, 2), max(3, 4))", 2.0),
            ("velocity.x * 2", -4.0),
            ("{density[1]} + {velocity.x}", 5.0),
            ("density > 0.2", 1.0),
            ("(density > 0.3) * 5 + 1", 1.0),
            ("1 + 1 < 3 && 2 * 2 >= 4 || 0", 1.0),
            ("!(density == 0.25)", 0.0),
            ("!0 != 0", 1.0),
            ("if(density < 1, x, 2)", 3.0),
            ("clamp(x, 0, 1) + mix(2, 4, 0.5) + smoothstep(0, 2, 1)", 4.5),
            ("cos(pi) + exp(0) + ln(1) + log10(100) + log2(8) + atan2(0, 1) + pow(x, 2)", 14.0),
            ("  abs( floor(-1.5) )  ", 2.0),
        ] {
            assert!((value(text) - expected).abs() < 1e-12, "{text}: {}", value(text));
        }
    }

    #[test]
    fn what_is_no_expression_is_named() {
        for (text, words) in [
            ("", "ends"),
            ("1 +", "ends"),
            ("(1", "ends"),
            ("density density", "'density'"),
            ("2 x", "'x'"),
            ("sin()", "')'"),
            ("sine(1)", "'(1)'"),
            ("min(1)", "'(1)'"),
            ("if(1, 2)", "'(1, 2)'"),
            ("{density", "ends"),
            ("a = 2", "'= 2'"),
            ("1 $ 2", "'$ 2'"),
            ("1 < 2)", "')'"),
        ] {
            let error = text.parse::<Expression>().unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
        for repeated in ["(", "-", "!", "2^", "sqrt(", "1+", "if("] {
            for count in [200, 100_000] {
                assert!(repeated.repeat(count / repeated.len()).parse::<Expression>().is_err(), "{repeated}");
            }
        }
        assert!(format!("{}1{}", "(".repeat(200), ")".repeat(200)).parse::<Expression>().is_ok());
        assert!("1*".repeat(10_000).parse::<Expression>().unwrap_err().contains("ends"));
    }
}
