//! Accessors decoded to numbers: every component type, normalised, strided, sparse, without a buffer view.
