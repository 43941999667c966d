use virtual_board::{image::Image, board::*, machine::*, time::*};
use shared::link::*; use shared::table::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let image = Image::parse(&std::fs::read(&args[1]).unwrap()).unwrap();
    let mut b = Board::new(image, Cost{instruction:0.6,access:10.0}).unwrap();
    b.lockstep();
    b.settle().unwrap();
    for i in 0..100 { b.sample([i as i16; 6]).unwrap(); }
    let mut session = 0; let mut seq = 0;
    let mut ask = |b: &mut Board, body: Request| -> Packet<Reply> {
        seq += 1;
        let f = encode(&Packet{version: VERSION, session, sequence: seq, body}).unwrap();
        b.send(&f);
        for _ in 0..40 {
            let until = b.now() + 50*MILLISECOND;
            let r = b.machine.run(until);
            if r == Ok(Stop::Gate) { break; }
            let m = &b.machine;
            println!("{r:?} at {:.6} instr {} pc {:x} closed {} idle {} next {:?} quiet {} passes {} acc {} running {} ops {}", in_seconds(b.now()), m.instructions(), m.pc(), b.bus().gate.is_closed(), m.idle().is_idle(b.bus()), b.bus().next(), b.bus().usart3.is_quiet(), m.idle().passes, b.bus().accesses, b.bus().nvic.running(), b.bus().flash.operations);
        }
        let mut c = Cutter::new();
        let p: Packet<Reply> = b.received().into_iter().filter_map(|x| c.push(x)).next().unwrap().unwrap();
        if p.body == Reply::Hello { session = p.session; }
        println!("{:?} at {:.6}", p.body, in_seconds(b.now()));
        p
    };
    ask(&mut b, Request::Hello(7));
    let mut room = [0; TABLE_ROOM];
    let mut t = *firmware::tables::NUCLEO_H743.table.get();
    t.supervision.settle = 10000;
    let t = t.validate().unwrap();
    let bytes = t.encode(&mut room).unwrap();
    for (at, piece) in (0..).step_by(256).zip(bytes.chunks(256)) { ask(&mut b, Request::Piece(at, piece.iter().copied().collect())); }
    ask(&mut b, Request::Keep(bytes.len() as u32, t.checksum()));
}
