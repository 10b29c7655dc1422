//! Buffers, buffer views, accessors: ranges inside ranges, by checked arithmetic.

use super::Document;
use crate::asset::accessor::{Header, MESHOPT, Slice, View, span};
use crate::asset::cursor::Cursor;
use crate::error::Result;

pub(super) fn check_buffer(_: &Document, buffer: &Cursor) -> Result<()> {
    buffer.object()?;
    buffer.need("byteLength")?.integer()?;
    if let Some(uri) = buffer.get("uri") {
        uri.string()?;
    }
    Ok(())
}

pub(super) fn check_view(document: &Document, view: &Cursor) -> Result<()> {
    view.object()?;
    check_in_buffer(document, view)?;
    for name in MESHOPT {
        if let Some(compressed) = view.extension(name) {
            check_in_buffer(document, &compressed)?;
        }
    }
    Ok(())
}

/// A range of a buffer, as a buffer view or a compressed view has it.
fn check_in_buffer(document: &Document, range: &Cursor) -> Result<()> {
    let view = View::parse(range)?;
    let buffer = range.need("buffer")?.index("buffers", document.length("buffers"))?;
    let length = document.top("buffers", buffer).and_then(|b| b.get("byteLength")?.integer().ok());
    let Some(length) = length else { return Ok(()) };
    match view.offset.checked_add(view.length) {
        Some(end) if end <= length => Ok(()),
        _ => Err(range.error(format!(
            "{} bytes from {} pass the end of buffers[{buffer}], which has {length}",
            view.length, view.offset
        ))),
    }
}

pub(super) fn check_accessor(document: &Document, accessor: &Cursor) -> Result<()> {
    accessor.object()?;
    let header = Header::parse(accessor)?;
    let (element, packed) = (header.element(), header.packed_stride());
    if let Some(data) = header.data {
        check_slice(document, accessor, data, element, packed, header.count)?;
    }
    let Some(sparse) = &header.sparse else { return Ok(()) };
    let place = accessor.need("sparse")?;
    if sparse.count > header.count {
        let message = format!("replaces {} elements, but there are {}", sparse.count, header.count);
        return Err(place.error(message));
    }
    let size = sparse.component.size();
    check_slice(document, &place.need("indices")?, sparse.indices, size, size, sparse.count)?;
    check_slice(document, &place.need("values")?, sparse.values, element, packed, sparse.count)
}

/// `count` elements must lie inside the buffer view and must not overlap.
fn check_slice(
    document: &Document,
    user: &Cursor,
    slice: Slice,
    element: usize,
    packed: usize,
    count: usize,
) -> Result<()> {
    document.check_index(user, "bufferView", "bufferViews")?;
    let view = document.top("bufferViews", slice.view).and_then(|view| View::parse(&view).ok());
    let Some(view) = view else { return Ok(()) };
    let stride = view.stride.unwrap_or(packed);
    if stride < element && count > 1 {
        let message = format!("elements of {element} bytes overlap at bufferViews[{}].byteStride {stride}", slice.view);
        return Err(user.error(message));
    }
    let end = span(stride, element, count).and_then(|length| slice.offset.checked_add(length));
    match end {
        Some(end) if end <= view.length => Ok(()),
        end => {
            let end = end.map_or("more bytes than can be counted".to_owned(), |end| format!("{end} bytes"));
            let message = format!("{count} elements of {element} bytes from byte {} need {end}", slice.offset);
            Err(user.error(format!("{message}; bufferViews[{}] has {}", slice.view, view.length)))
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::asset::check::check;
    use serde_json::{Value, json};

    fn first_problem(views: Value, accessors: Value) -> Option<String> {
        let root = json!({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 40}], "bufferViews": views,
            "accessors": accessors});
        check(&root).problems.first().map(ToString::to_string)
    }

    #[test]
    fn a_view_ends_inside_its_buffer() {
        let view = |offset: u64, length: u64| {
            first_problem(json!([{"buffer": 0, "byteOffset": offset, "byteLength": length}]), json!([]))
        };
        assert_eq!(view(4, 36), None);
        assert_eq!(view(8, 36).unwrap(), "/bufferViews/0: 36 bytes from 8 pass the end of buffers[0], which has 40");
        assert!(view(u64::MAX, u64::MAX).unwrap().contains("pass the end"));
    }

    #[test]
    fn an_accessor_ends_inside_its_view() {
        let views = json!([{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteLength": 36, "byteStride": 12},
            {"buffer": 0, "byteLength": 36, "byteStride": 4}, {"buffer": 0, "byteLength": 36, "byteStride": 0}]);
        let accessor = |view: usize, offset: u64, count: u64| {
            let accessor = json!({"bufferView": view, "byteOffset": offset, "componentType": 5126, "type": "VEC2",
                "count": count});
            first_problem(views.clone(), json!([accessor]))
        };
        assert_eq!(accessor(0, 4, 4), None);
        assert_eq!(accessor(1, 4, 3), None, "the last element needs no full stride");
        assert_eq!(accessor(3, 4, 4), None, "a stride of 0 means packed");
        assert!(accessor(0, 8, 4).unwrap().ends_with("from byte 8 need 40 bytes; bufferViews[0] has 36"));
        assert!(accessor(1, 8, 3).is_some());
        assert!(accessor(0, 0, u64::MAX).unwrap().contains("more bytes than can be counted"));
        assert!(accessor(2, 0, 2).unwrap().contains("elements of 8 bytes overlap"));
        assert!(accessor(9, 0, 2).unwrap().contains("names bufferViews[9]"));
    }
}
