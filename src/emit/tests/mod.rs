//! Small assets through the whole room: levels added, checked in memory, written, read back and checked again.

mod arrangement;
mod corpus;
mod layout;
mod primitives;
mod sketch;
