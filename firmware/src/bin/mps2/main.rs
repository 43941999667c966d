//! The controller on the emulated MPS2 board (AN386 or AN500): each request on
//! the UART carries the ADC codes of one sample and is answered with the DAC
//! codes. The plant is at the other end of the line.
#![no_std]
#![no_main]

mod stop;
mod uart;

use cortex_m_rt::entry;
use firmware::exchange::{FRAME, parse_request, refusal, reply};
use firmware::loop_task::LoopTask;
use firmware::tables::metrology_frame;

#[entry]
fn main() -> ! {
    let mut line = uart::Uart::take();
    let mut controller = LoopTask::new(&metrology_frame::TABLE);
    let mut frame = [0; FRAME];
    loop {
        line.read(&mut frame);
        let answer = match parse_request(&frame) {
            Ok(adc) => reply(&controller.on_sample(adc)),
            Err(_) => refusal(),
        };
        line.write(&answer);
    }
}
