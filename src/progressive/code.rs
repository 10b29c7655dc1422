//! Codes of numbers: differences to a prediction as integers, integers as bytes.

/// How one number of a vertex's row is stored, hence how it is predicted. A row holds every number as 32 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    /// The bits of a float. Where a vertex is not of the source, it is a multiple of 2 to the power of `step`; without a step every bit counts.
    Float {
        /// Exponent of the grid's step.
        step: Option<i8>,
    },
    /// An integer of any size up to 32 bits.
    Integer,
}

impl Number {
    /// `raw` as a vertex that is not of the source has it: on the grid.
    pub fn coarsen(self, raw: i32) -> i32 {
        match self {
            Self::Float { step: Some(step) } => on_grid(grid_index(raw, step), step),
            _ => raw,
        }
    }

    /// The difference that leads from `predicted` to `raw`, which must be on the grid unless `exact`.
    pub fn residual(self, exact: bool, predicted: i32, raw: i32) -> i32 {
        match self {
            Self::Float { step: Some(step) } if !exact => {
                grid_index(raw, step).wrapping_sub(grid_index(predicted, step))
            }
            Self::Float { .. } => ordered(raw).wrapping_sub(ordered(predicted)),
            Self::Integer => raw.wrapping_sub(predicted),
        }
    }

    /// The way back; `None` if that is no finite number.
    pub fn restore(self, exact: bool, predicted: i32, residual: i32) -> Option<i32> {
        let raw = match self {
            Self::Float { step: Some(step) } if !exact => {
                on_grid(grid_index(predicted, step).wrapping_add(residual), step)
            }
            // The order is its own inverse.
            Self::Float { .. } => ordered(ordered(predicted).wrapping_add(residual)),
            Self::Integer => return Some(predicted.wrapping_add(residual)),
        };
        value(raw).is_finite().then_some(raw)
    }

    /// What is expected at the second end of a split, given the joined value and the first end: as far on the other side.
    pub fn mirror(self, joined: i32, first: i32) -> i32 {
        match self {
            Self::Float { .. } => {
                let mirrored = (2.0 * f64::from(value(joined)) - f64::from(value(first))) as f32;
                if mirrored.is_finite() { mirrored.to_bits() as i32 } else { joined }
            }
            Self::Integer => joined.wrapping_mul(2).wrapping_sub(first),
        }
    }
}

fn value(raw: i32) -> f32 {
    f32::from_bits(raw as u32)
}

/// Bits of a float as an integer that grows with the float: neighbours differ by 1. Its own inverse.
fn ordered(raw: i32) -> i32 {
    if raw < 0 { raw ^ i32::MAX } else { raw }
}

fn power(step: i8) -> f64 {
    f64::from(step).exp2()
}

fn grid_index(raw: i32, step: i8) -> i32 {
    // Saturates; rows of a valid stream stay far below.
    (f64::from(value(raw)) / power(step) + 0.5).floor() as i32
}

fn on_grid(index: i32, step: i8) -> i32 {
    ((f64::from(index) * power(step)) as f32).to_bits() as i32
}

/// Appends `value`, seven bits a byte, low bits first.
pub(super) fn write_unsigned(mut value: u32, bytes: &mut Vec<u8>) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Appends `value`; small ones of either sign take few bytes.
pub(super) fn write_signed(value: i32, bytes: &mut Vec<u8>) {
    write_unsigned(((value << 1) ^ (value >> 31)) as u32, bytes);
}

/// Writes differences, of which many in a row are 0: a 0 is followed by how many more there are.
#[derive(Debug, Default)]
pub(super) struct Residuals {
    zeros: u32,
}

impl Residuals {
    pub fn write(&mut self, residual: i32, bytes: &mut Vec<u8>) {
        if residual == 0 {
            self.zeros += 1;
        } else {
            self.end(bytes);
            write_signed(residual, bytes);
        }
    }

    /// To be called after the last difference.
    pub fn end(&mut self, bytes: &mut Vec<u8>) {
        if let Some(more) = std::mem::take(&mut self.zeros).checked_sub(1) {
            write_signed(0, bytes);
            write_unsigned(more, bytes);
        }
    }

    /// The other way, as the reader.
    pub fn read(&mut self, reader: &mut Reader) -> Result<i32, Fault> {
        if let Some(left) = self.zeros.checked_sub(1) {
            self.zeros = left;
            return Ok(0);
        }
        let residual = reader.signed()?;
        if residual == 0 {
            self.zeros = reader.unsigned()?;
        }
        Ok(residual)
    }

    /// To be called after the last difference was read.
    pub fn check_end(&self) -> Result<(), Fault> {
        if self.zeros == 0 { Ok(()) } else { Err(Fault::Malformed("more zeros than there are numbers")) }
    }
}

/// CRC-32 (ISO 3309, as in PNG and zip) of `bytes`.
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum, &byte| CHECKSUMS[usize::from(sum as u8 ^ byte)] ^ sum >> 8)
}

/// What each byte does to a checksum.
const CHECKSUMS: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut sum = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            sum = if sum & 1 == 1 { 0xEDB8_8320 ^ sum >> 1 } else { sum >> 1 };
            bit += 1;
        }
        table[byte] = sum;
        byte += 1;
    }
    table
};

/// Why a record cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The bytes end inside it.
    Truncated,
    /// It breaks a rule of the format.
    Malformed(&'static str),
}

/// Bytes being read.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    pub fn byte(&mut self) -> Result<u8, Fault> {
        let byte = *self.bytes.get(self.at).ok_or(Fault::Truncated)?;
        self.at += 1;
        Ok(byte)
    }

    pub fn unsigned(&mut self) -> Result<u32, Fault> {
        let mut value = 0;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            let bits = u32::from(byte & 0x7F);
            if shift == 28 && bits > 0xF {
                break;
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Fault::Malformed("an integer of more than 32 bits"))
    }

    pub fn signed(&mut self) -> Result<i32, Fault> {
        let value = self.unsigned()?;
        Ok((value >> 1) as i32 ^ -((value & 1) as i32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn neighbouring_floats_differ_by_one_also_across_zero() {
        let bits = |x: f32| x.to_bits() as i32;
        let float = Number::Float { step: None };
        assert_eq!(float.residual(true, bits(1.0), bits(1.0 + f32::EPSILON)), 1);
        assert_eq!(float.residual(true, bits(-0.0), bits(0.0)), 1);
        assert_eq!(float.residual(true, bits(f32::from_bits(1)), bits(-f32::from_bits(1))), -3);
        assert_eq!(float.restore(true, bits(f32::MAX), 1), None, "infinity");
    }

    #[test]
    fn grid_values_are_counted_in_steps() {
        let bits = |x: f32| x.to_bits() as i32;
        let float = Number::Float { step: Some(-2) };
        assert_eq!(float.coarsen(bits(0.8)), bits(0.75));
        assert_eq!(float.coarsen(bits(-0.1)), bits(0.0), "no negative zero");
        assert_eq!(float.residual(false, bits(0.3), bits(-1.0)), -5);
        assert_eq!(float.restore(false, bits(0.3), -5), Some(bits(-1.0)));
        assert_eq!(float.mirror(bits(0.5), bits(0.75)), bits(0.25));
        assert_eq!(Number::Integer.mirror(7, 9), 5);
    }

    #[test]
    fn checksums_are_those_of_the_standard() {
        assert_eq!(checksum(b"123456789"), 0xCBF4_3926);
        assert_eq!(checksum(b""), 0);
    }

    #[test]
    fn an_integer_ends_after_32_bits() {
        let read = |bytes: &[u8]| Reader::new(bytes, 0).unsigned();
        assert_eq!(read(&[0xFF, 0xFF, 0xFF, 0xFF, 0x0F]), Ok(u32::MAX));
        assert!(matches!(read(&[0xFF, 0xFF, 0xFF, 0xFF, 0x1F]), Err(Fault::Malformed(_))));
        assert!(matches!(read(&[0xFF, 0xFF, 0xFF, 0xFF, 0x8F, 0]), Err(Fault::Malformed(_))));
        assert_eq!(read(&[0x80]), Err(Fault::Truncated));
    }

    proptest! {
        #[test]
        fn residuals_lead_back(predicted: i32, raw: i32, step in -30i8..10, exact: bool, by_integer: bool) {
            let finite = |raw: i32| f32::from_bits(raw as u32).is_finite();
            let number = if by_integer { Number::Integer } else { Number::Float { step: Some(step) } };
            let raw = if exact { raw } else { number.coarsen(raw) };
            prop_assume!(by_integer || finite(raw) && finite(predicted));
            let residual = number.residual(exact, predicted, raw);
            prop_assert_eq!(number.restore(exact, predicted, residual), Some(raw));
        }

        #[test]
        fn integers_are_read_as_written(value: i32) {
            let mut bytes = Vec::new();
            write_signed(value, &mut bytes);
            write_unsigned(value as u32, &mut bytes);
            let mut reader = Reader::new(&bytes, 0);
            prop_assert_eq!((reader.signed(), reader.unsigned()), (Ok(value), Ok(value as u32)));
            prop_assert_eq!(reader.at, bytes.len());
        }
    }
}
