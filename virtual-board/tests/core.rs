//! The core: exceptions, masks, faults and the taking of interrupts, by small programs in
//! machine code, against the ARMv7-M Architecture Reference Manual.

use virtual_board::image::Image;
use virtual_board::machine::{Machine, Stop};
use virtual_board::peripherals::nvic::IRQ;
use virtual_board::peripherals::scb::{
    BFARVALID, DACCVIOL, FORCED, IBUSERR, PRECISERR, STKERR, UNDEFINSTR,
};
use virtual_board::time::{Cost, MICROSECOND};

const STACK: u32 = 0x2001_0000;
const MAIN: u32 = 0x0800_1000;
/// Handlers: HardFault, then two interrupts.
const HARD: u32 = 0x0800_2000;
const FIRST: u32 = 0x0800_3000;
const SECOND: u32 = 0x0800_4000;

const B_SELF: u16 = 0xE7FE;
const BX_LR: u16 = 0x4770;
const NOP: u16 = 0xBF00;
const CPSID_I: u16 = 0xB672;
const CPSIE_I: u16 = 0xB662;
const CPSID_F: u16 = 0xB671;
const UDF: u16 = 0xDE00;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// A machine with `main` at its entry and code for the three handlers.
fn machine(main: &[u16], hard: &[u16], first: &[u16], second: &[u16]) -> Result<Machine, String> {
    let mut vectors = vec![0; 64];
    vectors[0] = STACK;
    vectors[1] = MAIN | 1;
    vectors[3] = HARD | 1;
    vectors[usize::from(IRQ)] = FIRST | 1;
    vectors[usize::from(IRQ) + 1] = SECOND | 1;
    let code = [(MAIN, main), (HARD, hard), (FIRST, first), (SECOND, second)];
    let mut machine = Machine::new(&Image::of_code(&vectors, &code), Cost::DEFAULT)?;
    machine.idle_mut().skips = false;
    let nvic = &mut machine.bus_mut().nvic;
    for irq in 0..2 {
        nvic.enable(IRQ + irq, true);
    }
    Ok(machine)
}

fn to(machine: &mut Machine, address: u32) -> Outcome {
    let until = machine.bus().now + 100 * MICROSECOND;
    match machine.run_to(until, Some(address))? {
        Stop::Address => Ok(()),
        stop => Err(format!("{stop:?} at {:#x}, not {address:#x}", machine.pc()).into()),
    }
}

fn word(machine: &Machine, address: u32) -> u32 {
    machine.bus().memory.word(address).unwrap_or(0)
}

/// B1.5.6: the frame, EXC_RETURN, and everything back after the return.
#[test]
fn a_frame_is_stacked_and_unstacked() -> Outcome {
    for (stack, aligned) in [(STACK - 16, false), (STACK - 20, true)] {
        let mut machine = machine(&[NOP, B_SELF], &[B_SELF], &[NOP, BX_LR], &[B_SELF])?;
        for (register, value) in [(0, 10), (1, 11), (2, 12), (3, 13), (4, 14), (12, 22)] {
            machine.set_register(register, value);
        }
        machine.set_register(13, stack);
        machine.set_register(14, 0x1234_5677);
        to(&mut machine, MAIN + 2)?;
        machine.bus_mut().nvic.set_pending(IRQ, true);
        to(&mut machine, FIRST)?;
        let frame = machine.register(13);
        assert_eq!(frame, stack - 32 - if aligned { 4 } else { 0 });
        let words: Vec<u32> = (0..7).map(|i| word(&machine, frame + 4 * i)).collect();
        assert_eq!(words, [10, 11, 12, 13, 22, 0x1234_5677, MAIN + 2]);
        let xpsr = word(&machine, frame + 28);
        assert_eq!(xpsr & 0x0100_03FF, 1 << 24 | u32::from(aligned) << 9);
        assert_eq!(machine.register(14), 0xFFFF_FFF9);
        assert_eq!(machine.bus().nvic.running(), IRQ);
        // The handler may change what is stacked.
        for register in [0, 1, 2, 3, 12] {
            machine.set_register(register, 99);
        }
        to(&mut machine, MAIN + 2)?;
        let back: Vec<u32> = [0, 1, 2, 3, 4, 12, 13, 14]
            .map(|i| machine.register(i))
            .into();
        assert_eq!(back, [10, 11, 12, 13, 14, 22, stack, 0x1234_5677]);
        assert_eq!(machine.bus().nvic.running(), 0);
    }
    Ok(())
}

/// B1.5.7: with floating-point context the frame is longer, and its registers come back.
#[test]
fn floating_point_registers_are_kept() -> Outcome {
    // vmov s0, r0; b .    handler: vmov s0, r1; bx lr
    let main = [0xEE00, 0x0A10, B_SELF];
    let handler = [0xEE00, 0x1A10, BX_LR];
    let mut machine = machine(&main, &[B_SELF], &handler, &[B_SELF])?;
    machine.set_register(0, 0x3F80_0000);
    machine.set_register(1, 0x4000_0000);
    to(&mut machine, MAIN + 4)?;
    machine.bus_mut().nvic.set_pending(IRQ, true);
    to(&mut machine, FIRST)?;
    let frame = machine.register(13);
    assert_eq!(frame, STACK - 104);
    assert_eq!(word(&machine, frame + 32), 0x3F80_0000);
    assert_eq!(machine.register(14), 0xFFFF_FFE9);
    to(&mut machine, FIRST + 4)?;
    // The handler has used the unit, so an exception in it stacks all again.
    machine.bus_mut().nvic.set_priority(IRQ, 0x80);
    machine.bus_mut().nvic.set_pending(IRQ + 1, true);
    to(&mut machine, SECOND)?;
    let inner = machine.register(13);
    assert_eq!(inner, frame - 104);
    assert_eq!(word(&machine, inner + 32), 0x4000_0000);
    assert_eq!(machine.register(14), 0xFFFF_FFE1);
    Ok(())
}

/// B1.5.4: a higher priority preempts, the same one waits.
#[test]
fn priorities_and_nesting() -> Outcome {
    let mut machine = machine(&[B_SELF], &[B_SELF], &[NOP, NOP, BX_LR], &[NOP, BX_LR])?;
    to(&mut machine, MAIN)?;
    machine.bus_mut().nvic.set_pending(IRQ, true);
    to(&mut machine, FIRST)?;
    machine.bus_mut().nvic.set_pending(IRQ + 1, true);
    to(&mut machine, FIRST + 4)?;
    to(&mut machine, SECOND)?;
    // One after the other.
    assert_eq!(machine.register(14), 0xFFFF_FFF9);
    to(&mut machine, MAIN)?;
    machine.bus_mut().nvic.set_priority(IRQ, 0x80);
    machine.bus_mut().nvic.set_pending(IRQ, true);
    to(&mut machine, FIRST + 2)?;
    machine.bus_mut().nvic.set_pending(IRQ + 1, true);
    to(&mut machine, SECOND)?;
    assert_eq!(machine.register(14), 0xFFFF_FFF1);
    to(&mut machine, FIRST + 2)?;
    to(&mut machine, MAIN)?;
    Ok(())
}

/// B1.4.3: masked, an interrupt waits; after the unmasking it is taken before the next
/// instruction.
#[test]
fn masks_hold_interrupts_back() -> Outcome {
    let msr_basepri_r0 = [0xF380, 0x8811];
    let msr_basepri_r1 = [0xF381, 0x8811];
    let cases: [(&[u16], &[u16]); 3] = [
        (&[CPSID_I, NOP], &[CPSIE_I, NOP]),
        (&[CPSID_F, NOP], &[0xB661, NOP]),
        (&msr_basepri_r0, &msr_basepri_r1),
    ];
    for (mask, unmask) in cases {
        let main = [mask, &[NOP, NOP, NOP], unmask, &[NOP, B_SELF]].concat();
        let mut machine = machine(&main, &[B_SELF], &[NOP, BX_LR], &[B_SELF])?;
        machine.bus_mut().nvic.set_priority(IRQ, 0x40);
        machine.set_register(0, 0x40);
        machine.set_register(1, 0);
        to(&mut machine, MAIN + 6)?;
        machine.bus_mut().nvic.set_pending(IRQ, true);
        to(&mut machine, MAIN + 10)?;
        to(&mut machine, FIRST)?;
        let stacked = word(&machine, machine.register(13) + 24);
        // After CPSIE or MSR itself.
        let after = MAIN
            + 10
            + if unmask.len() == 2 && unmask[1] == NOP {
                2
            } else {
                4
            };
        assert_eq!(stacked, after, "{mask:x?}");
    }
    Ok(())
}

/// B1.5.14: without its own handler a fault is a hard fault.
#[test]
fn faults_escalate() -> Outcome {
    // ldr r1, [r0]
    let cases = [
        (UDF, 0, UNDEFINSTR, None),
        (
            0x6801,
            0x1FFF_0000,
            PRECISERR | BFARVALID,
            Some(0x1FFF_0000),
        ),
        (
            0x6001,
            0x2002_0000,
            PRECISERR | BFARVALID,
            Some(0x2002_0000),
        ),
    ];
    for (instruction, r0, cause, address) in cases {
        let mut machine = machine(&[NOP, instruction, B_SELF], &[B_SELF], &[B_SELF], &[B_SELF])?;
        machine.set_register(0, r0);
        to(&mut machine, HARD)?;
        let scb = &machine.bus().scb;
        assert_eq!((scb.cfsr, scb.hfsr), (cause, FORCED));
        if let Some(address) = address {
            assert_eq!(scb.bfar, address);
        }
        // The frame holds the address of the instruction that failed.
        assert_eq!(word(&machine, machine.register(13) + 24), MAIN + 2);
    }
    // A branch to where nothing is: bx r0.
    let mut machine = machine(&[0x4700], &[B_SELF], &[B_SELF], &[B_SELF])?;
    machine.set_register(0, 0x3000_0001);
    to(&mut machine, HARD)?;
    assert_eq!(machine.bus().scb.cfsr, IBUSERR);
    Ok(())
}

/// B1.5.15: a fault in the hard fault's handler locks the core up; so does a stack overflow
/// if that handler pushes.
#[test]
fn a_stack_overflow_locks_up_a_handler_that_pushes() -> Outcome {
    // push {r4, lr} below the stack's memory.
    let push = 0xB510;
    let mut machine = machine(&[push, B_SELF], &[NOP, push, B_SELF], &[B_SELF], &[B_SELF])?;
    machine.set_register(13, 0x2000_0000);
    to(&mut machine, HARD)?;
    assert!(machine.bus().scb.cfsr & (PRECISERR | STKERR) == PRECISERR | STKERR);
    assert!(!machine.locked);
    let until = machine.bus().now + MICROSECOND;
    assert_eq!(machine.run(until)?, Stop::Time);
    assert!(machine.locked);
    assert_eq!(machine.bus().now, until);
    Ok(())
}

/// B3.5: what a region forbids is a fault; elsewhere the default map holds.
#[test]
fn the_mpu_forbids() -> Outcome {
    let mut machine = machine(&[0x6801, 0x6011, B_SELF], &[B_SELF], &[B_SELF], &[B_SELF])?;
    let bus = machine.bus_mut();
    // 4 KiB at 0x20001000: read-only. ldr r1, [r0]; str r1, [r2].
    bus.mpu.write(0xD9C, 0x2000_1000 | 1 << 4)?;
    bus.mpu.write(0xDA0, 6 << 24 | 11 << 1 | 1)?;
    bus.mpu.write(0xD94, 0b101)?;
    bus.mpu_changed = true;
    machine.set_register(0, 0x2000_1004);
    machine.set_register(2, 0x2000_1008);
    to(&mut machine, HARD)?;
    assert_eq!(machine.bus().scb.cfsr & 0xFF, DACCVIOL | 1 << 7);
    assert_eq!(machine.bus().scb.mmfar, 0x2000_1008);
    assert_eq!(word(&machine, machine.register(13) + 24), MAIN + 2);
    Ok(())
}

/// Instructions are counted one by one: a loop of known length, and an IT block.
#[test]
fn instructions_are_counted() -> Outcome {
    // movs r0, #100; loop: subs r0, #1; bne loop; cmp r0, r0; itttt eq; adds r1, #1 (4
    // times); b .
    let main = [
        0x2064, 0x3801, 0xD1FD, 0x4280, 0xBF01, 0x3101, 0x3101, 0x3101, 0x3101, B_SELF,
    ];
    let mut machine = machine(&main, &[B_SELF], &[B_SELF], &[B_SELF])?;
    let before = machine.instructions();
    to(&mut machine, MAIN + 18)?;
    assert_eq!(machine.instructions() - before, 1 + 200 + 1 + 1 + 4);
    assert_eq!(machine.register(1), 4);
    Ok(())
}

/// An interrupt is taken at the first boundary after it became pending; an IT block is one.
#[test]
fn interrupts_wait_for_an_it_block_at_most() -> Outcome {
    let main = [
        0x4280, 0xBF01, 0x3101, 0x3101, 0x3101, 0x3101, NOP, NOP, 0xE7F6,
    ];
    let cycle = 7_500;
    for late in 0..40 {
        let mut machine = machine(&main, &[B_SELF], &[NOP, BX_LR], &[B_SELF])?;
        // 64 MHz after a reset: a cycle is 7,500 ticks. A character of the link that ends
        // in the middle of the program serves as the event.
        let due = late * cycle + 1;
        machine.bus_mut().usart3.incoming.push_back(0);
        machine.bus_mut().usart3.line_baud = 10 * 480_000_000_000 / due;
        let now = machine.bus().now;
        machine.bus_mut().usart3.listen(now);
        let due = machine.bus().usart3.next().ok_or("due")?;
        let before = machine.bus().now;
        machine.run(due)?;
        let over = machine.bus().now - due;
        assert!(over <= 5 * cycle, "{over} ticks late of {}", due - before);
    }
    Ok(())
}
