//! Tiny PNG pictures, stored without compression: their bytes depend on no compressor's version.

/// An 8-bit RGBA picture of `size` × `size` pixels.
pub fn encode(size: u32, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let mut rows = Vec::new();
    for y in 0..size {
        rows.push(0); // filter: none
        (0..size).for_each(|x| rows.extend(pixel(x, y)));
    }
    let mut header = [size.to_be_bytes(), size.to_be_bytes()].concat();
    header.extend([8, 6, 0, 0, 0]);
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in [(b"IHDR", header), (b"IDAT", store_in_zlib(&rows)), (b"IEND", Vec::new())] {
        let body = [kind.as_slice(), &data].concat();
        out.extend((data.len() as u32).to_be_bytes());
        out.extend(&body);
        out.extend(crc32(&body).to_be_bytes());
    }
    out
}

/// A checkerboard of `cells` cells a side.
pub fn checkerboard(size: u32, cells: u32, dark: [u8; 4], light: [u8; 4]) -> Vec<u8> {
    encode(size, |x, y| if (x * cells / size + y * cells / size).is_multiple_of(2) { dark } else { light })
}

fn store_in_zlib(data: &[u8]) -> Vec<u8> {
    let length = u16::try_from(data.len()).expect("one stored block holds 64 KiB");
    let mut out = vec![0x78, 0x01, 1];
    out.extend(length.to_le_bytes());
    out.extend((!length).to_le_bytes());
    out.extend(data);
    let (a, b) = data.iter().fold((1_u32, 0_u32), |(a, b), &x| {
        let a = (a + u32::from(x)) % 65521;
        (a, (b + a) % 65521)
    });
    out.extend((b << 16 | a).to_be_bytes());
    out
}

fn crc32(data: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !data.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}
