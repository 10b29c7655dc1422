//! Accessors decoded to numbers: every component type, normalised, strided, sparse, without a buffer view.
//!
//! Comes in: the document's objects and the buffers' bytes. Goes out: flat arrays of `f32` or `u32`, element by
//! element, for all elements or for a chosen few. Nothing is allocated that the bytes present do not back.

use super::cursor::Cursor;
use super::geometry::{Component, Shape};
use crate::error::{Error, Kind, Result};
use serde_json::Value;

/// Extensions that keep a buffer view's data elsewhere, compressed.
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// An accessor without any data may have this many elements even in a file without bytes.
const ZEROS: usize = 65_536;

/// An accessor's members.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub component: Component,
    pub shape: Shape,
    pub normalized: bool,
    pub count: usize,
    /// Buffer view and byte offset in it; absent means zeros.
    pub data: Option<Slice>,
    pub sparse: Option<Sparse>,
}

/// A place in a buffer view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slice {
    pub view: usize,
    pub offset: usize,
}

/// Elements that differ from the accessor's data.
#[derive(Debug, Clone)]
pub(super) struct Sparse {
    pub count: usize,
    pub indices: Slice,
    pub component: Component,
    pub values: Slice,
}

/// A buffer view's members.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub buffer: usize,
    pub offset: usize,
    pub length: usize,
    /// Bytes from one element to the next; `None` (also for a stride of 0) means that they are packed.
    pub stride: Option<usize>,
    /// The extension that holds the data if `buffer` does not.
    pub compressed: Option<&'static str>,
}

impl Header {
    pub fn parse(accessor: &Cursor) -> Result<Self> {
        let component = parse_component(&accessor.need("componentType")?)?;
        let shape = accessor.need("type")?;
        let name = shape.string()?;
        let shape = Shape::from_name(name).ok_or_else(|| shape.expected("SCALAR, VEC2…4 or MAT2…4"))?;
        let normalized = accessor.get("normalized").map_or(Ok(false), |n| n.boolean())?;
        let count = accessor.need("count")?.integer()?;
        let data = match accessor.get("bufferView") {
            Some(_) => Some(Slice::parse(accessor)?),
            None => None,
        };
        let sparse = accessor.get("sparse").map(|sparse| Sparse::parse(&sparse)).transpose()?;
        Ok(Self { component, shape, normalized, count, data, sparse })
    }

    /// Bytes of one element, without padding after its last column.
    pub fn element(&self) -> usize {
        let layout = Layout::of(self.component, self.shape);
        (layout.columns - 1) * layout.column_stride + layout.rows * self.component.size()
    }

    /// Bytes from one element to the next when the buffer view does not say.
    pub fn packed_stride(&self) -> usize {
        let layout = Layout::of(self.component, self.shape);
        layout.columns * layout.column_stride
    }
}

fn parse_component(code: &Cursor) -> Result<Component> {
    let expected = || code.expected("5120, 5121, 5122, 5123, 5125 or 5126");
    code.value.as_u64().and_then(Component::from_code).ok_or_else(expected)
}

impl Slice {
    fn parse(object: &Cursor) -> Result<Self> {
        let view = object.need("bufferView")?.integer()?;
        let offset = object.get("byteOffset").map_or(Ok(0), |o| o.integer())?;
        Ok(Self { view, offset })
    }
}

impl Sparse {
    fn parse(sparse: &Cursor) -> Result<Self> {
        let (indices, values) = (sparse.need("indices")?, sparse.need("values")?);
        let component = indices.need("componentType")?;
        let found = parse_component(&component)?;
        if !matches!(found, Component::U8 | Component::U16 | Component::U32) {
            return Err(component.expected("5121, 5123 or 5125"));
        }
        Ok(Self {
            count: sparse.need("count")?.integer()?,
            indices: Slice::parse(&indices)?,
            component: found,
            values: Slice::parse(&values)?,
        })
    }
}

impl View {
    pub fn parse(view: &Cursor) -> Result<Self> {
        let stride = view.get("byteStride").map_or(Ok(0), |s| s.integer())?;
        Ok(Self {
            buffer: view.need("buffer")?.integer()?,
            offset: view.get("byteOffset").map_or(Ok(0), |o| o.integer())?,
            length: view.need("byteLength")?.integer()?,
            stride: (stride != 0).then_some(stride),
            compressed: MESHOPT.into_iter().find(|name| view.extension(name).is_some()),
        })
    }
}

/// How an element's components lie: columns of 1- and 2-byte components start at multiples of 4.
struct Layout {
    rows: usize,
    columns: usize,
    column_stride: usize,
}

impl Layout {
    fn of(component: Component, shape: Shape) -> Self {
        let (rows, columns) = match shape {
            Shape::Mat2 => (2, 2),
            Shape::Mat3 => (3, 3),
            Shape::Mat4 => (4, 4),
            vector => (vector.width(), 1),
        };
        let column = rows * component.size();
        Self { rows, columns, column_stride: if columns > 1 { column.next_multiple_of(4) } else { column } }
    }
}

/// Which elements to decode.
#[derive(Debug, Clone, Copy)]
pub(super) enum Select<'a> {
    /// All of them.
    All,
    /// These, ascending.
    Only(&'a [u32]),
}

/// An accessor with its bytes at hand.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    pub header: Header,
    pub place: String,
    base: Option<Strided<'a>>,
    sparse: Option<(Strided<'a>, Strided<'a>)>,
}

#[derive(Debug, Clone, Copy)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
}

/// Why an accessor's numbers are out of reach, if they are: the extension that compresses them.
pub(super) fn compression(root: &Value, buffers: &[Option<Vec<u8>>], accessor: usize) -> Option<&'static str> {
    let header = Header::parse(&Cursor::top(root, "accessors", accessor)?).ok()?;
    let sparse = header.sparse.iter().flat_map(|s| [s.indices, s.values]);
    header.data.into_iter().chain(sparse).find_map(|slice| {
        let view = View::parse(&Cursor::top(root, "bufferViews", slice.view)?).ok()?;
        view.compressed.filter(|_| !matches!(buffers.get(view.buffer), Some(Some(_))))
    })
}

impl<'a> Reader<'a> {
    /// Opens `accessors[index]` of a checked document.
    pub fn open(root: &Value, buffers: &'a [Option<Vec<u8>>], index: usize) -> Result<Self> {
        let place = format!("/accessors/{index}");
        let accessor = Cursor::top(root, "accessors", index)
            .ok_or_else(|| Error::malformed(&place, "there is no such accessor"))?;
        let header = Header::parse(&accessor)?;
        let open = |slice: Slice, count, element, packed| {
            open_slice(root, buffers, slice, count, element, packed)
                .ok_or_else(|| explain_absence(root, buffers, slice, &place))
        };
        let (element, packed) = (header.element(), header.packed_stride());
        let base = header.data.map(|slice| open(slice, header.count, element, packed)).transpose()?;
        let sparse = match &header.sparse {
            Some(s) => {
                let size = s.component.size();
                Some((open(s.indices, s.count, size, size)?, open(s.values, s.count, element, packed)?))
            }
            None => None,
        };
        if base.is_none() {
            check_zeros(&header, buffers, &place)?;
        }
        Ok(Self { header, place, base, sparse })
    }

    /// Appends the chosen elements to `out` as floats; normalised integers become [0, 1] or [−1, 1].
    pub fn read_floats(&self, select: Select, out: &mut Vec<f32>) -> Result<()> {
        self.read(select, out, |strided, select, out| self.decode_floats(strided, select, out))
    }

    /// Appends the chosen elements of an unsigned accessor to `out`; other component types give zeros.
    pub fn read_unsigned(&self, select: Select, out: &mut Vec<u32>) -> Result<()> {
        self.read(select, out, |strided, select, out| {
            let layout = Layout::of(self.header.component, self.header.shape);
            decode_unsigned(self.header.component, strided, &layout, self.header.count, select, out);
        })
    }

    fn read<T: Copy + Default>(
        &self,
        select: Select,
        out: &mut Vec<T>,
        decode: impl Fn(Strided, Select, &mut Vec<T>),
    ) -> Result<()> {
        let (start, width) = (out.len(), self.header.shape.width());
        match self.base {
            Some(base) => decode(base, select, out),
            None => {
                let count = if let Select::Only(chosen) = select { chosen.len() } else { self.header.count };
                out.resize(start + count * width, T::default());
            }
        }
        let (Some((indices, values)), Some(sparse)) = (self.sparse, &self.header.sparse) else { return Ok(()) };
        let mut targets = Vec::new();
        let scalar = Layout::of(sparse.component, Shape::Scalar);
        decode_unsigned(sparse.component, indices, &scalar, sparse.count, Select::All, &mut targets);
        if let Some((i, &target)) = targets.iter().enumerate().find(|(_, t)| **t as usize >= self.header.count) {
            let message = format!("entry {i} replaces element {target}, but there are {}", self.header.count);
            return Err(Error::malformed(format!("{}/sparse/indices", self.place), message));
        }
        let mut replacements = Vec::new();
        let all: Vec<u32> = (0..targets.len() as u32).collect();
        decode(values, Select::Only(&all), &mut replacements);
        for (&target, value) in targets.iter().zip(replacements.chunks_exact(width)) {
            let slot = match select {
                Select::All => Some(target as usize),
                Select::Only(chosen) => chosen.binary_search(&target).ok(),
            };
            let slot = slot.and_then(|slot| out.get_mut(start + slot * width..)?.get_mut(..width));
            if let Some(slot) = slot {
                slot.copy_from_slice(value);
            }
        }
        Ok(())
    }

    fn decode_floats(&self, strided: Strided, select: Select, out: &mut Vec<f32>) {
        let layout = Layout::of(self.header.component, self.header.shape);
        let count = self.header.count;
        let norm = self.header.normalized;
        macro_rules! decode_as {
            ($type:ty, $convert:expr) => {
                decode(strided, &layout, count, select, |b| $convert(<$type>::from_le_bytes(b)), out)
            };
        }
        match self.header.component {
            Component::F32 => decode_as!(f32, |x: f32| x),
            Component::I8 if norm => decode_as!(i8, |x: i8| (f32::from(x) / 127.0).max(-1.0)),
            Component::I8 => decode_as!(i8, f32::from),
            Component::U8 if norm => decode_as!(u8, |x: u8| f32::from(x) / 255.0),
            Component::U8 => decode_as!(u8, f32::from),
            Component::I16 if norm => decode_as!(i16, |x: i16| (f32::from(x) / 32767.0).max(-1.0)),
            Component::I16 => decode_as!(i16, f32::from),
            Component::U16 if norm => decode_as!(u16, |x: u16| f32::from(x) / 65535.0),
            Component::U16 => decode_as!(u16, f32::from),
            Component::U32 if norm => decode_as!(u32, |x: u32| (f64::from(x) / f64::from(u32::MAX)) as f32),
            Component::U32 => decode_as!(u32, |x: u32| x as f32),
        }
    }
}

/// Elements without bytes of their own are zeros, and a small file could ask for any number of them: a mesh has
/// at least a byte of index or attribute data for each vertex.
fn check_zeros(header: &Header, buffers: &[Option<Vec<u8>>], place: &str) -> Result<()> {
    let bytes: usize = buffers.iter().flatten().map(Vec::len).sum();
    let (count, most) = (header.count, bytes.max(ZEROS));
    if count <= most {
        return Ok(());
    }
    let message = format!("{count} elements without data; with these buffers no more than {most} are believed");
    Err(Error { kind: Kind::Limit, ..Error::malformed(place, message) })
}

/// Why an accessor has no bytes.
fn explain_absence(root: &Value, buffers: &[Option<Vec<u8>>], slice: Slice, place: &str) -> Error {
    let view = Cursor::top(root, "bufferViews", slice.view).and_then(|view| View::parse(&view).ok());
    match view.map(|view| view.buffer) {
        Some(buffer) if matches!(buffers.get(buffer), Some(None)) => {
            Error::malformed(format!("/buffers/{buffer}"), format!("{NO_DATA}, and {place} needs it"))
        }
        _ => Error::malformed(place, "its bytes are not there"),
    }
}

/// What is wrong with a buffer that comes from nowhere.
pub(super) const NO_DATA: &str = "the buffer has neither a uri nor the BIN chunk of a GLB";

/// The bytes of `count` elements, or `None` where they are not all there.
fn open_slice<'a>(
    root: &Value,
    buffers: &'a [Option<Vec<u8>>],
    slice: Slice,
    count: usize,
    element: usize,
    packed: usize,
) -> Option<Strided<'a>> {
    let view = View::parse(&Cursor::top(root, "bufferViews", slice.view)?).ok()?;
    let bytes = buffers.get(view.buffer)?.as_ref()?;
    let bytes = bytes.get(view.offset..view.offset.checked_add(view.length)?)?;
    let stride = view.stride.unwrap_or(packed);
    let length = span(stride, element, count)?;
    let bytes = bytes.get(slice.offset..slice.offset.checked_add(length)?)?;
    Some(Strided { bytes, stride })
}

/// Bytes from the first byte of the first element to the last of the last; `None` when that is beyond the machine.
pub(super) fn span(stride: usize, element: usize, count: usize) -> Option<usize> {
    match count.checked_sub(1) {
        None => Some(0),
        Some(steps) => steps.checked_mul(stride)?.checked_add(element),
    }
}

fn decode_unsigned(
    component: Component,
    strided: Strided,
    layout: &Layout,
    count: usize,
    select: Select,
    out: &mut Vec<u32>,
) {
    match component {
        Component::U8 => decode(strided, layout, count, select, |[b]| u32::from(b), out),
        Component::U16 => decode(strided, layout, count, select, |b| u32::from(u16::from_le_bytes(b)), out),
        Component::U32 => decode(strided, layout, count, select, u32::from_le_bytes, out),
        _ => decode(strided, layout, count, select, |_: [u8; 1]| 0, out),
    }
}

/// Appends the chosen elements' components, `N` bytes each.
fn decode<const N: usize, T>(
    strided: Strided,
    layout: &Layout,
    count: usize,
    select: Select,
    convert: impl Fn([u8; N]) -> T,
    out: &mut Vec<T>,
) {
    let convert = |bytes: &[u8; N]| convert(*bytes);
    let column = layout.rows * N;
    let packed = layout.columns == 1 && strided.stride == column;
    if let (true, Select::All) = (packed, select) {
        out.extend(strided.bytes.as_chunks::<N>().0.iter().map(convert));
        return;
    }
    let mut push = |element: usize| {
        for c in 0..layout.columns {
            let start = element * strided.stride + c * layout.column_stride;
            let bytes = strided.bytes.get(start..).and_then(|rest| rest.get(..column)).unwrap_or_default();
            out.extend(bytes.as_chunks::<N>().0.iter().map(convert));
        }
    };
    match select {
        Select::All => (0..count).for_each(push),
        Select::Only(chosen) => chosen.iter().for_each(|&i| push(i as usize)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn floats(root: &Value, bytes: &[u8], select: Select) -> Result<Vec<f32>> {
        let buffers = [Some(bytes.to_vec())];
        let mut out = Vec::new();
        Reader::open(root, &buffers, 0)?.read_floats(select, &mut out)?;
        Ok(out)
    }

    fn accessor(component: u32, shape: &str, count: usize, more: Value) -> Value {
        let mut accessor = json!({"bufferView": 0, "componentType": component, "type": shape, "count": count});
        accessor.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        json!({"accessors": [accessor], "bufferViews": [{"buffer": 0, "byteLength": 64}]})
    }

    fn padded(bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        bytes.resize(64, 0xEE);
        bytes
    }

    #[test]
    fn integers_are_read_plain_and_normalised() {
        type Case = (u32, &'static [u8], [f32; 2], [f32; 2]);
        let cases: [Case; 4] = [
            (5120, &[0x81, 0x7f], [-127.0, 127.0], [-1.0, 1.0]),
            (5121, &[0, 255], [0.0, 255.0], [0.0, 1.0]),
            (5122, &[0x00, 0x80, 0xff, 0x7f], [-32768.0, 32767.0], [-1.0, 1.0]),
            (5123, &[0x00, 0x00, 0xff, 0xff], [0.0, 65535.0], [0.0, 1.0]),
        ];
        for (component, bytes, plain, normalised) in cases {
            let read = |more| floats(&accessor(component, "SCALAR", 2, more), &padded(bytes), Select::All).unwrap();
            assert_eq!(read(json!({})), plain, "{component}");
            assert_eq!(read(json!({"normalized": true})), normalised, "{component}");
        }
    }

    #[test]
    fn matrix_columns_of_small_components_are_padded() {
        let bytes = padded(&[1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0, 7, 8]);
        let root = accessor(5121, "MAT2", 2, json!({}));
        assert_eq!(floats(&root, &bytes, Select::All).unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
        assert_eq!(floats(&root, &bytes, Select::Only(&[1])).unwrap(), [5.0, 6.0, 7.0, 8.0]);
        let bytes = padded(&[1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9]);
        let root = accessor(5121, "MAT3", 1, json!({}));
        assert_eq!(floats(&root, &bytes, Select::All).unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    }

    #[test]
    fn strides_and_offsets_are_followed() {
        let mut root = accessor(5121, "VEC2", 3, json!({"byteOffset": 1}));
        root["bufferViews"][0]["byteStride"] = json!(4);
        let bytes = padded(&[0, 1, 2, 0, 0, 3, 4, 0, 0, 5, 6]);
        assert_eq!(floats(&root, &bytes, Select::All).unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(floats(&root, &bytes, Select::Only(&[0, 2])).unwrap(), [1.0, 2.0, 5.0, 6.0]);
    }

    #[test]
    fn sparse_entries_replace_elements_also_of_an_accessor_without_data() {
        let sparse = json!({"sparse": {"count": 2,
            "indices": {"bufferView": 0, "byteOffset": 8, "componentType": 5121},
            "values": {"bufferView": 0, "byteOffset": 12}}});
        let bytes = padded(&[10, 20, 30, 40, 0, 0, 0, 0, 1, 3, 0, 0, 7, 8]);
        let mut root = accessor(5121, "SCALAR", 4, sparse);
        assert_eq!(floats(&root, &bytes, Select::All).unwrap(), [10.0, 7.0, 30.0, 8.0]);
        assert_eq!(floats(&root, &bytes, Select::Only(&[2, 3])).unwrap(), [30.0, 8.0]);
        root["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        assert_eq!(floats(&root, &bytes, Select::All).unwrap(), [0.0, 7.0, 0.0, 8.0]);
        root["accessors"][0]["count"] = json!(3);
        let message = floats(&root, &bytes, Select::All).unwrap_err().to_string();
        assert_eq!(message, "/accessors/0/sparse/indices: entry 1 replaces element 3, but there are 3");
    }

    #[test]
    fn zeros_are_believed_only_as_far_as_the_buffers_go() {
        let mut root = accessor(5126, "VEC3", 1 << 40, json!({}));
        root["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        assert_eq!(floats(&root, &[], Select::All).unwrap_err().kind, Kind::Limit);
        root["accessors"][0]["count"] = json!(2);
        assert_eq!(floats(&root, &[], Select::All).unwrap(), [0.0; 6]);
    }
}
