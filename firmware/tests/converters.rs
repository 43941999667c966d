//! The converters' frames against their data sheets, the drivers against a mocked bus,
//! what a bus does wrong included.

use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use embedded_hal_mock::eh1::spi::{Mock, Transaction};
use firmware::converters::ad5676r::{self, Ad5676r, DacChannel, DacCommand, DacError};
use firmware::converters::ad7606::{self, Lines};
use shared::LEGS;
use shared::codes::DacCode;

/// A bus that fails after so many transfers, and says how many it was asked for.
struct Failing {
    good: usize,
    asked: usize,
}

impl ErrorType for &mut Failing {
    type Error = ErrorKind;
}

impl SpiDevice for &mut Failing {
    fn transaction(&mut self, _: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        self.asked += 1;
        if self.asked > self.good {
            Err(ErrorKind::ModeFault)
        } else {
            Ok(())
        }
    }
}

/// AD7606, output coding: full scale −32768 is 0x8000, full scale less one LSB 0x7FFF,
/// 0 V 0x0000; V1 to V3 from DOUTA, V5 to V7 from DOUTB, the highest bit first.
#[test]
fn adc_codes_are_the_data_sheets() {
    let lines: Lines = [[0x8000, 0x7FFF, 0x0000], [0x0001, 0xFFFF, 0x1234]];
    let codes = [-32768, 32767, 0, 1, -1, 0x1234];
    assert_eq!(ad7606::decode(lines).map(|code| code.0), codes);
}

const CODES: [DacCode; LEGS] = [
    DacCode(0x8000),
    DacCode(0),
    DacCode(0xFFFF),
    DacCode(0x1234),
    DacCode(1),
    DacCode(0x7FFF),
];

/// AD5676R, command definitions and address commands.
#[test]
fn dac_frames_are_the_data_sheets() {
    let [first, .., last] = DacChannel::ALL;
    for (command, frame) in [
        (DacCommand::Nothing, [0x00, 0x00, 0x00]),
        (
            DacCommand::Write(first, DacCode(0x8000)),
            [0x10, 0x80, 0x00],
        ),
        (DacCommand::Write(last, DacCode(0x1234)), [0x15, 0x12, 0x34]),
        (
            DacCommand::WriteAndUpdate(last, DacCode(0xABCD)),
            [0x35, 0xAB, 0xCD],
        ),
        (DacCommand::Reset, [0x60, 0x12, 0x34]),
        (DacCommand::InternalReference, [0x70, 0x00, 0x00]),
        (DacCommand::ReadBack(last), [0x95, 0x00, 0x00]),
    ] {
        assert_eq!(command.encode(), frame, "{command:?}");
    }
    assert_eq!(ad5676r::decode(&[0x95, 0xAB, 0xCD]), DacCode(0xABCD));
}

fn framed(bytes: [u8; ad5676r::FRAME]) -> [Transaction<u8>; 3] {
    [
        Transaction::transaction_start(),
        Transaction::write_vec(bytes.to_vec()),
        Transaction::transaction_end(),
    ]
}

/// Six frames, one a channel; no output moves before LDAC.
#[test]
fn a_write_is_six_frames() {
    let mut device = Mock::new(&[]);
    let frames = Ad5676r::new(device.clone()).frames(CODES);
    let expected = [
        0x10_8000, 0x11_0000, 0x12_FFFF, 0x13_1234, 0x14_0001, 0x15_7FFF,
    ];
    assert_eq!(frames, expected);
    device.done();
}

/// What a start sends, and what the channels read back.
fn start(back: &[u16]) -> Vec<Transaction<u8>> {
    let mut all = Vec::new();
    all.extend(framed([0x60, 0x12, 0x34]));
    all.extend(framed([0x70, 0, 0]));
    for i in 0..LEGS as u8 {
        all.extend(framed([0x30 | i, 0x80, 0x00]));
    }
    for (i, back) in (0..).zip(back) {
        all.extend(read_back(i, *back));
    }
    all
}

/// The start tells a part that answers from one that does not: SDO stuck low.
#[test]
fn a_start_reads_back() {
    let safe = [DacCode(0x8000); LEGS];
    let mut device = Mock::new(&start(&[0x8000; LEGS]));
    assert_eq!(Ad5676r::new(device.clone()).start(safe), Ok(()));
    device.done();
    let mut device = Mock::new(&start(&[0x8000, 0x8000, 0]));
    let found = Ad5676r::new(device.clone()).start(safe);
    assert_eq!(found, Err(DacError::ReadBack));
    device.done();
}

/// A question for a channel's code, and the answer.
fn read_back(channel: u8, code: u16) -> impl Iterator<Item = Transaction<u8>> {
    let [high, low] = code.to_be_bytes();
    let answer = [
        Transaction::transaction_start(),
        Transaction::transfer_in_place(vec![0; 3], vec![0, high, low]),
        Transaction::transaction_end(),
    ];
    framed([0x90 | channel, 0, 0]).into_iter().chain(answer)
}

/// While the loop runs, one channel after the other is read back: the code of the last frames,
/// or of those before them if LDAC has not come. Any other is an error.
#[test]
fn outputs_are_read_back_in_turn() {
    let codes = |base: u16| [0, 1, 2, 3, 4, 5].map(|i| DacCode(base + i));
    let mut expected = Vec::new();
    let found = [200, 101, 0xFFFF, 203, 104, 205, 0, 201];
    for (channel, code) in (0..).zip(found) {
        expected.extend(read_back(channel % 6, code));
    }
    let mut device = Mock::new(&expected);
    let mut dac = Ad5676r::new(device.clone());
    dac.frames(codes(100));
    dac.frames(codes(200));
    let outcomes = found.map(|_| dac.read_back().is_ok());
    // 0xFFFF is a wire that is stuck high, 0 one that is stuck low.
    assert_eq!(outcomes, [true, true, false, true, true, true, false, true]);
    device.done();
}

/// A transfer that fails ends a start at once, wherever it is.
#[test]
fn a_start_that_fails_is_an_error() {
    for good in 0..10 {
        let mut bus = Failing { good, asked: 0 };
        let found = Ad5676r::new(&mut bus).start(CODES);
        assert_eq!(found, Err(DacError::Bus));
        assert_eq!(bus.asked, good + 1);
    }
}
