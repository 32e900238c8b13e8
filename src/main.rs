//! The `caustica` command.

fn main() {}
