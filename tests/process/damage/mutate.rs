//! Damage to files: to their bytes, and to the structure of JSON and XML.

use super::Dice;
use serde_json::{Map, Value};

/// What a file is made of, which decides what damage it gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Syntax {
    Binary,
    Json,
    Xml,
}

/// A damaged copy, and what was done to it.
pub fn damage(whole: &[u8], syntax: Syntax, dice: &mut Dice) -> (Vec<u8>, String) {
    let mut bytes = whole.to_vec();
    let mut done = Vec::new();
    // A text rarely survives damage to its bytes as a document: most of the damage keeps the syntax whole.
    let rounds = *dice.choose(&[1, 1, 1, 2, 3, 8]);
    if syntax != Syntax::Binary && dice.below(6) > 0 {
        let text = String::from_utf8(bytes).unwrap();
        let (text, how) =
            if syntax == Syntax::Json { json(&text, rounds.min(3), dice) } else { xml(text, rounds.min(3), dice) };
        return (text.into_bytes(), how);
    }
    for _ in 0..rounds {
        done.push(binary(&mut bytes, dice));
    }
    (bytes, done.join(", "))
}

/// A place in a file. Half of all damage goes to the first 1500 bytes, where headers are, and an eighth to the last
/// 800, where point attributes have their lengths.
fn place(length: usize, dice: &mut Dice) -> usize {
    match dice.below(8) {
        0..=3 => dice.below(length.min(1500)),
        4 => length - 1 - dice.below(length.min(800)),
        _ => dice.below(length),
    }
}

fn binary(bytes: &mut Vec<u8>, dice: &mut Dice) -> String {
    if bytes.is_empty() {
        bytes.push(0);
    }
    let at = place(bytes.len(), dice);
    let left = bytes.len() - at;
    // What moves all that follows is found out early by most readers: three in sixteen do.
    match dice.below(19) {
        16.. => named(bytes, dice),
        0..=4 => {
            let bit = dice.below(8);
            bytes[at] ^= 1 << bit;
            format!("bit {bit} of byte {at}")
        }
        5 | 6 => {
            let n = left.min(1 + dice.below(64));
            let value = *dice.choose(&[0, 0xff, 0x7f, 0x80, b' ']);
            bytes[at..at + n].fill(value);
            format!("{n} bytes of {value:#x} at {at}")
        }
        7 | 8 => {
            let n = left.min(1 + dice.below(32));
            let random = dice.bytes(n);
            bytes[at..at + n].copy_from_slice(&random);
            format!("{n} random bytes at {at}")
        }
        9 => {
            bytes.truncate(at);
            format!("cut at {at}")
        }
        10 => {
            let n = 1 + dice.below(64);
            let new = dice.bytes(n);
            bytes.splice(at..at, new);
            format!("{n} bytes inserted at {at}")
        }
        11 => {
            let n = left.min(1 + dice.below(64));
            bytes.drain(at..at + n);
            format!("{n} bytes removed at {at}")
        }
        12 => {
            let other = dice.below(bytes.len());
            let n = (1 + dice.below(256)).min(at.abs_diff(other)).min(left).min(bytes.len() - other);
            for i in 0..n {
                bytes.swap(at + i, other + i);
            }
            format!("{n} bytes of {at} and {other} swapped")
        }
        _ => {
            let new = number(dice);
            let n = left.min(new.len());
            bytes[at..at + n].copy_from_slice(&new[..n]);
            format!("{:02x?} at {at}", &new[..n])
        }
    }
}

/// Names in the headers of EXR and VDB files behind which sizes, kinds and places are stored.
const NAMES: [&str; 16] = [
    "dataWindow\0box2i\0",
    "displayWindow\0box2i\0",
    "compression\0compression\0",
    "channels\0chlist\0",
    "tiles\0tiledesc\0",
    "chunkCount\0int\0",
    "pixelAspectRatio\0float\0",
    "lineOrder\0lineOrder\0",
    "file_compression",
    "file_bbox_max",
    "file_voxel_count",
    "is_saved_as_half_float",
    "class",
    "ScaleMap",
    "ScaleTranslateMap",
    "AffineMap",
];

/// Damages the value of a name: a number a few places behind it, among them sizes that a small file can claim.
fn named(bytes: &mut [u8], dice: &mut Dice) -> String {
    let found: Vec<(&str, usize)> = NAMES
        .iter()
        .flat_map(|name| {
            let ends = bytes.windows(name.len()).enumerate().filter(|(_, w)| *w == name.as_bytes());
            ends.map(|(i, _)| (*name, i + name.len())).collect::<Vec<_>>()
        })
        .collect();
    if found.is_empty() {
        return "no name to damage".into();
    }
    let (name, end) = *dice.choose(&found);
    let at = (end + 4 * dice.below(6)).min(bytes.len() - 1);
    let new = if dice.below(2) == 0 {
        dice.choose(&[100_i32, 1023, 4095, 11_000, 32_767, 65_535, 1 << 20, 1 << 28]).to_le_bytes().to_vec()
    } else {
        number(dice)
    };
    let n = new.len().min(bytes.len() - at);
    bytes[at..at + n].copy_from_slice(&new[..n]);
    format!("{:02x?} {} bytes behind {:?}", &new[..n], at - end, name)
}

/// A number of the kinds that binary files hold, and of the values that go wrong.
fn number(dice: &mut Dice) -> Vec<u8> {
    const INTEGERS: [i64; 14] = [
        0,
        -1,
        1,
        2,
        31,
        255,
        4096,
        65_536,
        1 << 20,
        i32::MAX as i64,
        i32::MIN as i64,
        u32::MAX as i64,
        i64::MAX,
        i64::MIN,
    ];
    const REALS: [f64; 11] =
        [0.0, -0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308, 1e-310, 1e30, f64::MIN_POSITIVE];
    match dice.below(4) {
        0 => (*dice.choose(&INTEGERS) as i32).to_le_bytes().to_vec(),
        1 => dice.choose(&INTEGERS).to_le_bytes().to_vec(),
        2 => (*dice.choose(&REALS) as f32).to_le_bytes().to_vec(),
        _ => dice.choose(&REALS).to_le_bytes().to_vec(),
    }
}

/// Numbers as texts, among them some that are no JSON or no number of 64 bits.
const NUMBERS: [&str; 21] = [
    "0",
    "-1",
    "1",
    "0.5",
    "2",
    "-0.0",
    "1e308",
    "-1e308",
    "1e400",
    "1e-320",
    "1e12",
    "-1e12",
    "1e6",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "9223372036854775807",
    "18446744073709551616",
    "NaN",
    "Infinity",
];

/// Texts that are no name, or one that must not be followed.
fn text(dice: &mut Dice) -> String {
    match dice.below(9) {
        0 => String::new(),
        1 => ".".into(),
        2 => "../../../../../etc/passwd".into(),
        3 => "/dev/zero".into(),
        4 => "/dev/null".into(),
        5 => "\u{1b}]0;title\u{7}\u{1b}[31m".into(),
        6 => "a\u{0}b\nc".into(),
        7 => "x".repeat(10_000),
        _ => "\u{202e}\u{fffd}#%{}$(id)".into(),
    }
}

/// Stands in the tree for what is no JSON value; written out, its quotation marks are replaced with it.
const RAW: &str = "@raw@";
/// The same for a key that an object has already.
const TWICE: &str = "@twice@";

fn json(whole: &str, rounds: usize, dice: &mut Dice) -> (String, String) {
    let mut root: Value = serde_json::from_str(whole).unwrap();
    let (mut raws, mut keys, mut done) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..rounds {
        let mut count = 0;
        visit(&mut root, "", &mut |_, _| count += 1);
        let (wanted, mut i) = (dice.below(count), 0);
        visit(&mut root, "", &mut |path, value| {
            if i == wanted {
                done.push(format!("{path}: {}", retype(value, &mut raws, &mut keys, dice)));
            }
            i += 1;
        });
    }
    let mut text = serde_json::to_string_pretty(&root).unwrap();
    for (i, raw) in raws.iter().enumerate() {
        text = text.replace(&format!("\"{RAW}{i}\""), raw);
    }
    for (i, key) in keys.iter().enumerate() {
        text = text.replace(&format!("\"{TWICE}{i}\""), &Value::from(key.as_str()).to_string());
    }
    (text, done.join(", "))
}

/// Every value of a tree, from the root on.
fn visit(value: &mut Value, path: &str, each: &mut impl FnMut(&str, &mut Value)) {
    each(path, value);
    match value {
        Value::Array(list) => {
            for (i, v) in list.iter_mut().enumerate() {
                visit(v, &format!("{path}[{i}]"), each);
            }
        }
        Value::Object(map) => map.iter_mut().for_each(|(k, v)| visit(v, &format!("{path}.{k}"), each)),
        _ => {}
    }
}

/// Damages one value, and says how.
fn retype(value: &mut Value, raws: &mut Vec<String>, keys: &mut Vec<String>, dice: &mut Dice) -> String {
    let mut raw = |text: String| {
        raws.push(text);
        Value::from(format!("{RAW}{}", raws.len() - 1))
    };
    match (dice.below(8), &mut *value) {
        (0..=2, Value::Object(map)) if !map.is_empty() => {
            let key = map.keys().nth(dice.below(map.len())).unwrap().clone();
            map.remove(&key);
            return format!("'{key}' dropped");
        }
        (3 | 4, Value::Object(map)) if !map.is_empty() => {
            let key = map.keys().nth(dice.below(map.len())).unwrap().clone();
            let other = raw(NUMBERS[dice.below(NUMBERS.len())].into());
            let copy = if dice.below(2) == 0 { map[&key].clone() } else { other };
            map.insert(format!("{TWICE}{}", keys.len()), copy);
            keys.push(key.clone());
            return format!("'{key}' twice");
        }
        (0, Value::Array(list)) if !list.is_empty() => {
            list.remove(dice.below(list.len()));
            return "an element dropped".into();
        }
        (1, Value::Array(list)) if !list.is_empty() => {
            let one = list[dice.below(list.len())].clone();
            let times = *dice.choose(&[1, 3, 100]);
            list.extend(std::iter::repeat_n(one, times));
            return format!("an element {times} times more");
        }
        (2, Value::Array(list)) if list.len() > 1 => {
            let (a, b) = (dice.below(list.len()), dice.below(list.len()));
            list.swap(a, b);
            return format!("elements {a} and {b} swapped");
        }
        (0..=4, Value::Number(_)) => {
            let number = *dice.choose(&NUMBERS);
            *value = raw(number.into());
            return format!("now {number}");
        }
        (5, Value::Number(n)) => {
            let factor = *dice.choose(&[-1.0, 0.5, 10.0, 1e3, 1e-3, 1e6, 1e9]);
            let product = n.as_f64().unwrap_or(1.0) * factor;
            *value = product.into();
            return format!("times {factor}");
        }
        (0..=4, Value::String(_)) => {
            *value = text(dice).into();
            return "another text".into();
        }
        _ => {}
    }
    let (new, how) = match dice.below(8) {
        0 => (Value::Null, "null"),
        1 => (Value::from(dice.below(2) == 0), "a truth value"),
        2 => (Value::from(dice.below(100)), "a number"),
        3 => (text(dice).into(), "a text"),
        4 => (Value::Array(Vec::new()), "an empty list"),
        5 => (Value::Object(Map::new()), "an empty object"),
        6 => {
            let depth = *dice.choose(&[2, 100, 130, 10_000, 100_000]);
            (raw("[".repeat(depth) + &"]".repeat(depth)), "lists within lists")
        }
        _ => {
            let depth = *dice.choose(&[2, 100, 130, 10_000]);
            (raw("{\"a\":".repeat(depth) + "1" + &"}".repeat(depth)), "objects within objects")
        }
    };
    *value = new;
    format!("now {how}")
}

fn xml(mut text: String, rounds: usize, dice: &mut Dice) -> (String, String) {
    let mut done = Vec::new();
    for _ in 0..rounds {
        let at = |text: &str, what: char, dice: &mut Dice| -> Option<usize> {
            let all: Vec<usize> = text.match_indices(what).map(|(i, _)| i).collect();
            (!all.is_empty()).then(|| *dice.choose(&all))
        };
        done.push(match dice.below(7) {
            0..=2 => {
                // An attribute's value: from one quotation mark to the next, if no bracket lies between.
                let values: Vec<(usize, usize)> = text
                    .match_indices("=\"")
                    .filter_map(|(i, _)| Some((i + 2, i + 2 + text[i + 2..].find('"')?)))
                    .collect();
                let Some(&(from, to)) = values.get(dice.below(values.len())) else { continue };
                let new = match dice.below(6) {
                    0 => "x".repeat(10_000),
                    1 => "&#27;[31m&#0;".into(),
                    2 => "&unknown;&amp;".into(),
                    _ => (*dice.choose(&NUMBERS)).to_owned(),
                };
                text.replace_range(from..to, &new);
                format!("attribute at {from}")
            }
            3 => {
                let lines: Vec<&str> = text.lines().collect();
                let (from, to) = (dice.below(lines.len()), dice.below(lines.len()));
                let times = *dice.choose(&[0, 2, 1000]);
                let mut new: Vec<&str> = lines.clone();
                let line = new.remove(from);
                new.splice(to.min(new.len())..to.min(new.len()), std::iter::repeat_n(line, times));
                text = new.join("\n");
                format!("line {from} {times} times at {to}")
            }
            4 => {
                let depth = *dice.choose(&[2, 100, 10_000]);
                let Some(at) = at(&text, '<', dice) else { continue };
                text.insert_str(at, &("<a>".repeat(depth)));
                format!("{depth} elements opened at {at}")
            }
            5 => {
                let Some(at) = at(&text, '<', dice) else { continue };
                let bomb = "<!DOCTYPE x [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>";
                text.insert_str(at, bomb);
                format!("a document type at {at}")
            }
            _ => {
                let what = *dice.choose(&['<', '>', '"', '=', '/', '&']);
                let Some(at) = at(&text, what, dice) else { continue };
                text.remove(at);
                format!("'{what}' dropped at {at}")
            }
        });
    }
    (text, done.join(", "))
}
