//! Binary frames: what goes to pages many times a second. Little-endian; a head of six 32-bit numbers, then
//! times as 64-bit and values as 32-bit floating point. The book has the same in words.

use crate::history::{History, Series};

const ROWS: u32 = 1;
const SERIES: u32 = 2;

/// Most rows of a frame; what is between is left out evenly.
pub const ROWS_MAX: usize = 256;
/// Most rows of the first frame of a line.
pub const ROWS_FIRST: usize = 6000;

fn head(numbers: [u32; 6], capacity: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(24 + capacity);
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    bytes
}

/// The rows of a line after the first `sent`: kind 1, line, place of the first row, number of rows here, number
/// of columns, number of rows of the line; times; rows of the drawn columns. The last row is always there.
pub fn rows(line: u32, history: &History, sent: usize) -> Vec<u8> {
    let (total, width) = (history.rows(), history.drawn.len());
    let news = total - sent;
    let most = if sent == 0 { ROWS_FIRST } else { ROWS_MAX };
    let count = news.min(most);
    let numbers = [
        ROWS,
        line,
        sent as u32,
        count as u32,
        width as u32,
        total as u32,
    ];
    let mut bytes = head(numbers, count * (8 + 4 * width));
    let chosen = |k: usize| sent + (k + 1) * news / count - 1;
    for k in 0..count {
        bytes.extend(history.times[chosen(k)].to_le_bytes());
    }
    for k in 0..count {
        for &column in &history.drawn {
            bytes.extend((history.value(chosen(k), column) as f32).to_le_bytes());
        }
    }
    bytes
}

/// An answer to a request for series: kind 2, the request's number, line, number of points, number of signals,
/// 0; times; values signal after signal.
pub fn series(request: u32, line: u32, series: &Series) -> Vec<u8> {
    let (points, signals) = (series.times.len(), series.columns.len());
    let numbers = [SERIES, request, line, points as u32, signals as u32, 0];
    let mut bytes = head(numbers, points * (8 + 4 * signals));
    bytes.extend(series.times.iter().flat_map(|t| t.to_le_bytes()));
    let values = series.columns.iter().flatten();
    bytes.extend(values.flat_map(|value| value.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use appell_sim::record::{Header, Recorder};
    use appell_sim::signal::Signal;

    fn number(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
    }

    #[test]
    fn known_answer_of_frames() {
        let header = Header {
            signals: vec![
                Signal::new("robot.r.pose.x", "m"),
                Signal::new("robot.r.clearance", "m"),
            ],
            ..Header::default()
        };
        let mut history = History::new(&header);
        for k in 0..10_000 {
            history
                .frame(k as f64, &[2.0 * k as f64, 0.0])
                .expect("keeps");
        }
        assert_eq!(history.drawn, [0]);
        let bytes = rows(7, &history, 9_990);
        let head: Vec<u32> = (0..6).map(|k| number(&bytes, 4 * k)).collect();
        assert_eq!(head, [1, 7, 9_990, 10, 1, 10_000]);
        assert_eq!(bytes.len(), 24 + 10 * 12);
        assert_eq!(bytes[24..32], 9_990.0_f64.to_le_bytes());
        assert_eq!(bytes[24 + 80..][..4], 19_980.0_f32.to_le_bytes());
        // Of many rows some, the last among them.
        for (sent, most) in [(0, ROWS_FIRST), (1, ROWS_MAX)] {
            let bytes = rows(7, &history, sent);
            assert_eq!(number(&bytes, 12) as usize, most);
            let last = 24 + 8 * (most - 1);
            assert_eq!(bytes[last..last + 8], 9_999.0_f64.to_le_bytes());
        }
        let found = history.series(&["robot.r.pose.x".to_owned()], 0.0, 4.0, 100);
        let bytes = series(3, 7, &found);
        let head: Vec<u32> = (0..6).map(|k| number(&bytes, 4 * k)).collect();
        assert_eq!(head, [2, 3, 7, 6, 1, 0]);
        assert_eq!(bytes.len(), 24 + 6 * 12);
    }
}
