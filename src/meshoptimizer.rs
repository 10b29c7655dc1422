//! The one door to the C++ library: checks every index and length, then calls it.
