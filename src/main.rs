//! The doorcam program.

fn main() {}
