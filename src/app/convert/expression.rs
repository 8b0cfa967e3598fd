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
/// Most characters of operators, each of which takes stack while values are computed.
const MOST_OPERATORS: usize = 2000;

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
    /// A function by its name, with what stands in its brackets.
    Call(String, Vec<Node>),
    /// A value by the place of its name.
    Value(usize),
    /// A function of as many parts as it takes.
    Apply(Function, Vec<Node>),
}

/// A function with its name or operator; functions are equal if these are.
#[derive(Debug, Clone, Copy)]
struct Function(&'static str, Kind);

/// Arithmetic of one number, of two or of three.
#[derive(Debug, Clone, Copy)]
enum Kind {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
    Three(fn(f64, f64, f64) -> f64),
}

impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}

/// Functions that are called by their names.
const FUNCTIONS: [Function; 23] = [
    Function("abs", Kind::One(f64::abs)),
    Function("floor", Kind::One(f64::floor)),
    Function("ceil", Kind::One(f64::ceil)),
    Function("round", Kind::One(f64::round)),
    Function("exp", Kind::One(f64::exp)),
    Function("ln", Kind::One(f64::ln)),
    Function("log2", Kind::One(f64::log2)),
    Function("log10", Kind::One(f64::log10)),
    Function("sqrt", Kind::One(f64::sqrt)),
    Function("sin", Kind::One(f64::sin)),
    Function("cos", Kind::One(f64::cos)),
    Function("tan", Kind::One(f64::tan)),
    Function("asin", Kind::One(f64::asin)),
    Function("acos", Kind::One(f64::acos)),
    Function("atan", Kind::One(f64::atan)),
    Function("min", Kind::Two(f64::min)),
    Function("max", Kind::Two(f64::max)),
    Function("pow", Kind::Two(f64::powf)),
    Function("atan2", Kind::Two(f64::atan2)),
    Function("if", Kind::Three(|condition, then, other| if is_true(condition) { then } else { other })),
    Function("clamp", Kind::Three(|v, low, high| v.max(low).min(high))),
    Function("mix", Kind::Three(|a, b, share| a + (b - a) * share)),
    Function("smoothstep", Kind::Three(smoothstep)),
];

fn smoothstep(low: f64, high: f64, v: f64) -> f64 {
    let t = ((v - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

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
            Self::Name(_) | Self::Call(..) => f64::NAN,
            Self::Apply(Function(_, kind), of) => match kind {
                Kind::One(function) => function(of[0].value(values)),
                Kind::Two(function) => function(of[0].value(values), of[1].value(values)),
                Kind::Three(function) => function(of[0].value(values), of[1].value(values), of[2].value(values)),
            },
        }
    }

    /// Replaces names by their places among those met so far, and calls by functions.
    fn resolved(self, names: &mut Vec<String>) -> Result<Self, String> {
        let (function, of) = match self {
            Self::Number(_) | Self::Value(_) => return Ok(self),
            Self::Name(name) => {
                let place = names.iter().position(|known| *known == name).unwrap_or(names.len());
                if place == names.len() {
                    names.push(name);
                }
                return Ok(Self::Value(place));
            }
            Self::Call(name, of) => (called(&name, of.len())?, of),
            Self::Apply(function, of) => (function, of),
        };
        let of = of.into_iter().map(|part| part.resolved(names)).collect::<Result<_, String>>()?;
        Ok(Self::Apply(function, of))
    }
}

/// Returns the function of a name, if it takes so many numbers.
fn called(name: &str, given: usize) -> Result<Function, String> {
    let Some(function) = FUNCTIONS.iter().find(|function| function.0 == name) else {
        let all: Vec<&str> = FUNCTIONS.iter().map(|function| function.0).collect();
        return Err(format!("there is no function '{name}'; there are {}", all.join(", ")));
    };
    let taken = match function.1 {
        Kind::One(_) => 1,
        Kind::Two(_) => 2,
        Kind::Three(_) => 3,
    };
    let some = if taken == 1 { "number" } else { "numbers" };
    if given == taken { Ok(*function) } else { Err(format!("'{name}' takes {taken} {some}, {given} given")) }
}

impl FromStr for Expression {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let count = |bytes: &[u8]| text.bytes().filter(|byte| bytes.contains(byte)).count();
        let (nested, operators) = (count(b"(+-!^"), count(b"*/<>=&|"));
        for (found, most, what) in [
            (nested, MOST_NESTED, "brackets, signs and powers"),
            (operators, MOST_OPERATORS, "products, quotients, comparisons and logical operators"),
        ] {
            if found > most {
                return Err(format!(
                    "the expression has {found} {what}, {most} at most are parsed: compute a part of it as a grid first"
                ));
            }
        }
        let parsed = delimited(multispace0, node, multispace0).parse(text).map_err(|e| {
            let (before, behind) = text.split_at(e.offset());
            if behind.trim().is_empty() {
                format!("'{text}' ends where a number, a name or a bracket is expected")
            } else {
                format!("'{text}' is no expression: '{behind}' does not fit behind '{before}'")
            }
        });
        let mut names = Vec::new();
        let root = parsed?.resolved(&mut names)?;
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

fn one(name: &'static str, function: fn(f64) -> f64, a: Node) -> Node {
    Node::Apply(Function(name, Kind::One(function)), vec![a])
}

fn two(name: &'static str, function: fn(f64, f64) -> f64, a: Node, b: Node) -> Node {
    Node::Apply(Function(name, Kind::Two(function)), vec![a, b])
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
        '-'.value(Prefix(9, |_: &mut &str, a| Ok(one("-", |v| -v, a)))),
        '+'.value(Prefix(9, |_: &mut &str, a| Ok(a))),
        '!'.value(Prefix(9, |_: &mut &str, a| Ok(one("!", |v| truth(!is_true(v)), a)))),
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
    if opt(preceded(multispace0, '(')).parse_next(input)?.is_none() {
        return Ok(if name == "pi" { Node::Number(std::f64::consts::PI) } else { Node::Name(name.to_owned()) });
    }
    let of = cut_err(separated(1.., node, ',')).parse_next(input)?;
    cut_err(')').parse_next(input)?;
    Ok(Node::Call(name.to_owned(), of))
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
            ("sine(1)", "no function 'sine'"),
            ("1 + min(1)", "'min' takes 2 numbers, 1 given"),
            ("max(if(1, 2), 3)", "'if' takes 3 numbers, 2 given"),
            ("-sqrt(1, 2)", "'sqrt' takes 1 number, 2 given"),
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
        for operator in ["*", "/", "<", "&&"] {
            let long = |count: usize| format!("1{}", format!("{operator}1").repeat(count)).parse::<Expression>();
            assert!(long(60_000).unwrap_err().contains("at most"), "{operator}");
            assert!(long(1000).unwrap().value(&[]).is_finite(), "{operator}");
        }
    }
}
