//! The compression of XTC: whole numbers, those of atoms near the one before in few bits.
//!
//! | what | bits |
//! |---|---|
//! | largest and smallest coordinate of each axis, level of small differences | seven i32 before the bytes |
//! | an atom | its coordinates above the smallest, as one number in the mixed radix of the three ranges; each by itself where a range exceeds 2²⁴ |
//! | 1 bit | 1 if the run of small differences that follows has another length than the last one, or the level changes |
//! | 5 bits, after a 1 | three times the number of small differences, plus 1 plus the change of the level (−1, 0, 1) |
//! | a small difference | to the atom before, in `level` bits: one number in three digits of radix [`RADIX`]`[level]` |
//!
//! The first atom of a run is exchanged with the atom before it, as hydrogens of water stand around their oxygen. Numbers of
//! more than 8 bits are stored with their lowest byte first, bits within a byte from the highest on.

/// Radix r of each level: the largest with r³ ≤ 2^level, to about 1 in 10³.
const RADIX: [u32; 73] = [
    0, 0, 0, 0, 0, 0, 0, 0, 0, 8, 10, 12, 16, 20, 25, 32, 40, 50, 64, 80, 101, 128, 161, 203, 256, 322, 406,
    512, 645, 812, 1024, 1290, 1625, 2048, 2580, 3250, 4096, 5060, 6501, 8192, 10321, 13003, 16384, 20642,
    26007, 32768, 41285, 52015, 65536, 82570, 104031, 131072, 165140, 208063, 262144, 330280, 416127, 524287,
    660561, 832255, 1048576, 1321122, 1664510, 2097152, 2642245, 3329021, 4194304, 5284491, 6658042, 8388607,
    10568983, 13316085, 16777216,
];

/// The first level that has a radix.
const FIRST: usize = 9;

/// Levels that a frame may use above that of its nearest neighbours.
const LEVELS: usize = 8;

/// Most small differences in a run.
const LONGEST_RUN: usize = 8;

/// Ranges above this are stored axis by axis.
const LARGE: u64 = 0xff_ffff;

/// How the coordinates of an atom are stored.
enum Width {
    /// As one number of so many bits.
    Together(u32),
    /// Each by itself.
    Apart([u32; 3]),
}

/// Bits of the numbers below `count`.
fn bits(count: u128) -> u32 {
    128 - count.saturating_sub(1).leading_zeros()
}

/// Bits as other programs count them: of the number of values itself.
fn width(ranges: [u64; 3]) -> Width {
    match ranges.iter().any(|r| *r > LARGE) {
        true => Width::Apart(ranges.map(|r| bits(u128::from(r) + 1))),
        false => Width::Together(bits(ranges.iter().map(|r| u128::from(*r)).product::<u128>() + 1)),
    }
}

/// Writes bits, the highest of a byte first.
struct BitWriter<'a> {
    bytes: &'a mut Vec<u8>,
    /// Bits of the last byte that are still free.
    free: u32,
}

impl BitWriter<'_> {
    fn put(&mut self, number: u32, count: u32) {
        let mut left = count;
        while left > 0 {
            if self.free == 0 {
                self.bytes.push(0);
                self.free = 8;
            }
            let now = left.min(self.free);
            let part = (u64::from(number) >> (left - now)) & ((1 << now) - 1);
            if let Some(last) = self.bytes.last_mut() {
                *last |= (part as u8) << (self.free - now);
            }
            (left, self.free) = (left - now, self.free - now);
        }
    }
    /// A number of many bits, its lowest byte first.
    fn put_long(&mut self, mut number: u128, count: u32) {
        let mut left = count;
        while left > 8 {
            self.put((number & 0xff) as u32, 8);
            (number, left) = (number >> 8, left - 8);
        }
        self.put((number & 0xff) as u32, left);
    }
    /// Three digits of a mixed radix.
    fn put_digits(&mut self, digits: [u64; 3], radix: [u64; 3], count: u32) {
        let [a, b, c] = digits.map(u128::from);
        self.put_long((a * u128::from(radix[1]) + b) * u128::from(radix[2]) + c, count);
    }
}

/// Reads bits; `None` behind the end.
struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl BitReader<'_> {
    fn take(&mut self, count: u32) -> Option<u32> {
        let (mut number, mut left) = (0u64, count);
        while left > 0 {
            let byte = u64::from(*self.bytes.get(self.at / 8)?);
            let free = 8 - (self.at % 8) as u32;
            let now = left.min(free);
            number = number << now | (byte >> (free - now)) & ((1 << now) - 1);
            (left, self.at) = (left - now, self.at + now as usize);
        }
        u32::try_from(number).ok()
    }
    fn take_long(&mut self, count: u32) -> Option<u128> {
        let (mut number, mut shift) = (0u128, 0);
        while count - shift > 8 {
            number |= u128::from(self.take(8)?) << shift;
            shift += 8;
        }
        Some(number | u128::from(self.take(count - shift)?) << shift)
    }
    fn take_digits(&mut self, radix: [u64; 3], count: u32) -> Option<[u64; 3]> {
        let number = self.take_long(count)?;
        let [first, second, third] = radix.map(u128::from);
        let (rest, c) = (number / third, number % third);
        let (a, b) = (rest / second, rest % second);
        // A hostile number may exceed the first radix.
        (a < first).then_some([a as u64, b as u64, c as u64])
    }
}

fn difference(a: [i32; 3], b: [i32; 3]) -> [i64; 3] {
    std::array::from_fn(|i| i64::from(a[i]) - i64::from(b[i]))
}

/// True if a difference fits into the digits of a level.
fn fits(d: [i64; 3], level: usize) -> bool {
    let half = i64::from(RADIX[level] / 2);
    d.iter().all(|d| d.abs() < half)
}

/// Appends the seven numbers, the length, and the bytes, padded to a multiple of four.
pub(super) fn compress(numbers: &[[i32; 3]], out: &mut Vec<u8>) {
    let least: [i32; 3] = std::array::from_fn(|i| numbers.iter().map(|x| x[i]).min().unwrap_or(0));
    let most: [i32; 3] = std::array::from_fn(|i| numbers.iter().map(|x| x[i]).max().unwrap_or(0));
    let ranges = difference(most, least).map(|d| d as u64 + 1);
    let sizes =
        numbers.windows(2).map(|w| difference(w[1], w[0]).iter().map(|d| d.unsigned_abs()).sum::<u64>());
    let nearest = sizes.min().unwrap_or(0);
    let last = RADIX.len() - 1;
    let first = (FIRST..last).find(|level| u64::from(RADIX[*level]) >= nearest).unwrap_or(last);
    let top = (first + LEVELS).min(last);
    let bottom = FIRST.max(top.saturating_sub(LEVELS));
    for number in least.iter().chain(&most) {
        out.extend(number.to_be_bytes());
    }
    out.extend((first as i32).to_be_bytes());
    let start = out.len();
    out.extend([0; 4]);
    let width = width(ranges);
    let mut writer = BitWriter { bytes: out, free: 0 };
    let (mut level, mut run_before, mut i) = (first, 0, 0);
    while i < numbers.len() {
        // A run goes from one atom to the next while they are near.
        let near =
            |k: usize, level: usize| k < numbers.len() && fits(difference(numbers[k], numbers[k - 1]), level);
        let run_at = |level: usize| {
            // The exchange of the first two makes the third the neighbour of the first.
            let mut run = 0;
            while run < LONGEST_RUN {
                let k = i + run + 1;
                let is_near = match run {
                    1 => k < numbers.len() && fits(difference(numbers[k], numbers[i]), level),
                    _ => near(k, level),
                };
                if !is_near {
                    break;
                }
                run += 1;
            }
            run
        };
        let run = run_at(level);
        // The level serves this run; the next one may have another.
        let next = i + run + 1;
        let change: i32 = match next + 1 < numbers.len() {
            true if level < top && !near(next + 1, level) && near(next + 1, level + 1) => 1,
            true if level > bottom && near(next + 1, level - 1) => -1,
            _ => 0,
        };
        let whole = if run > 0 { numbers[i + 1] } else { numbers[i] };
        let digits = difference(whole, least).map(|d| d as u64);
        match width {
            Width::Together(count) => writer.put_digits(digits, ranges, count),
            Width::Apart(counts) => (0..3).for_each(|k| writer.put(digits[k] as u32, counts[k])),
        }
        if run != run_before || change != 0 {
            writer.put(1, 1);
            writer.put((3 * run as i32 + change + 1) as u32, 5);
            run_before = run;
        } else {
            writer.put(0, 1);
        }
        let mut before = whole;
        for k in 0..run {
            let this = if k == 0 { numbers[i] } else { numbers[i + 1 + k] };
            let half = i64::from(RADIX[level] / 2);
            let digits = difference(this, before).map(|d| (d + half) as u64);
            writer.put_digits(digits, [u64::from(RADIX[level]); 3], level as u32);
            before = this;
        }
        level = (level as i32 + change) as usize;
        i = next;
    }
    let length = (out.len() - start - 4) as i32;
    out.splice(start..start + 4, length.to_be_bytes());
    out.resize(out.len().next_multiple_of(4), 0);
}

/// All numbers of a frame; `None` where the bytes or the seven numbers are not those of one.
pub(super) fn decompress(head: &[i32], bytes: &[u8], count: usize) -> Option<Vec<[i32; 3]>> {
    let &[x0, y0, z0, x1, y1, z1, first] = head else { return None };
    let (least, most) = ([x0, y0, z0], [x1, y1, z1]);
    let spans = difference(most, least);
    let mut level = usize::try_from(first).ok().filter(|l| (FIRST..RADIX.len()).contains(l))?;
    if spans.iter().any(|d| *d < 0) {
        return None;
    }
    let ranges = spans.map(|d| d as u64 + 1);
    let width = width(ranges);
    let mut reader = BitReader { bytes, at: 0 };
    // Bytes bound the number of atoms: each has a flag at least, or is one of a run.
    let mut out = Vec::with_capacity(count.min(1 << 16));
    let mut run = 0;
    let add = |a: i32, d: i64| i32::try_from(i64::from(a) + d).ok();
    while out.len() < count {
        let digits = match width {
            Width::Together(bits) => reader.take_digits(ranges, bits)?,
            Width::Apart(bits) => {
                let [a, b, c] = bits;
                [reader.take(a)?, reader.take(b)?, reader.take(c)?].map(u64::from)
            }
        };
        let mut whole = least;
        for k in 0..3 {
            whole[k] = add(least[k], i64::try_from(digits[k]).ok()?)?;
        }
        let mut change = 0;
        if reader.take(1)? == 1 {
            let code = reader.take(5)?;
            (run, change) = (code as usize / 3, code as i32 % 3 - 1);
        }
        let (radix, half) = (RADIX[level], i64::from(RADIX[level] / 2));
        let mut before = whole;
        for k in 0..run {
            let digits = reader.take_digits([u64::from(radix); 3], level as u32)?;
            let mut this = before;
            for axis in 0..3 {
                this[axis] = add(before[axis], digits[axis] as i64 - half)?;
            }
            out.push(this);
            // The first small difference is of the atom that stands before.
            if k == 0 {
                out.push(whole);
            }
            before = this;
        }
        if run == 0 {
            out.push(whole);
        }
        level = usize::try_from(level as i32 + change).ok().filter(|l| (FIRST..RADIX.len()).contains(l))?;
    }
    (out.len() == count).then_some(out)
}
