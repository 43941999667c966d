//! The emulated board: each request on the UART carries the ADC codes of one
//! sample and is answered with the DAC codes. The plant is at the other end of
//! the line.

mod stop;
mod uart;

use firmware::exchange::{REQUEST, parse_request, refusal, reply};
use firmware::loop_task::LoopTask;
use shared::table::ValidTable;

/// Runs the controller of `table` for ever.
pub fn run(table: &'static ValidTable) -> ! {
    let mut line = uart::Uart::take();
    let mut controller = LoopTask::new(table);
    let mut frame = [0; REQUEST];
    loop {
        line.read(&mut frame);
        let answer = match parse_request(&frame) {
            Ok(adc) => reply(&controller.on_sample(adc)),
            Err(_) => refusal(),
        };
        line.write(&answer);
    }
}
