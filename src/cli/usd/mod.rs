//! `cumulo usd`: stages written and checked.

mod author;
mod lint;
