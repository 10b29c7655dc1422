//! Small assets through the whole room: levels added, checked in memory, written, read back and checked again.

mod arrangement;
mod sketch;
