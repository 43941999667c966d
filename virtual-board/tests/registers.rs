//! Addresses, names, offsets and bits of registers, interrupts, clocks' bits and pins, against
//! the `stm32-metapac` crate: its tables were made from ST's own files, not by the authors of
//! the model.

use std::collections::BTreeMap;

use stm32_metapac::metadata::ir::{Array, BitOffset, Block as Layout, BlockItemInner, IR};
use stm32_metapac::metadata::{METADATA, Peripheral};
use virtual_board::bus::{Block, Bus};
use virtual_board::peripherals::{
    Register, dbgmcu, dma, flash, gpio, iwdg, pwr, rcc, spi, syscfg, tim1, usart,
};
use virtual_board::time::Cost;
use virtual_board::wires::{Pin, pins};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// What the model has of a peripheral: ST's name for it, its registers, and what their names
/// begin with there.
type Modelled = (&'static str, &'static [Register], &'static str);

const MODELLED: [Modelled; 15] = [
    ("SPI3", &spi::REGISTERS, "SPI_"),
    ("SPI4", &spi::REGISTERS, "SPI_"),
    ("SPI5", &spi::REGISTERS, "SPI_"),
    ("USART3", &usart::REGISTERS, "USART3_"),
    ("TIM1", &tim1::REGISTERS, "TIM1_"),
    ("FLASH", &flash::REGISTERS, "FLASH_"),
    ("SYSCFG", &syscfg::REGISTERS, "SYSCFG_"),
    ("IWDG1", &iwdg::REGISTERS, "IWDG_"),
    ("GPIOA", &gpio::REGISTERS, "GPIO_"),
    ("GPIOC", &gpio::REGISTERS, "GPIO_"),
    ("GPIOG", &gpio::REGISTERS, "GPIO_"),
    ("GPIOK", &gpio::REGISTERS, "GPIO_"),
    ("RCC", &rcc::REGISTERS, "RCC_"),
    ("PWR", &pwr::REGISTERS, "PWR_"),
    ("DBGMCU", &dbgmcu::REGISTERS, "DBGMCU_"),
];

fn peripheral(name: &str) -> Result<&'static Peripheral, String> {
    let found = METADATA.peripherals.iter().find(|p| p.name == name);
    found.ok_or_else(|| format!("no {name}"))
}

/// A register's name in the crate.
fn other_name(name: &str) -> String {
    match name {
        "TXDR" | "RXDR" => format!("{name}32"),
        "CCMR1" | "CCMR2" => name.replace("CCMR", "CCMR_OUTPUT"),
        "ECC_FA1R" => "FAR1".to_owned(),
        "ECC_FA2R" => "FAR2".to_owned(),
        _ => match name.strip_prefix("PLL").map(|rest| rest.split_at(1)) {
            Some((number @ ("1" | "2" | "3"), what)) => format!("PLL{what}{number}"),
            _ => name.to_owned(),
        },
    }
}

fn places(array: &Option<Array>) -> Vec<u32> {
    match array {
        None => vec![0],
        Some(Array::Regular(regular)) => (0..regular.len).map(|i| i * regular.stride).collect(),
        Some(Array::Cursed(cursed)) => cursed.offsets.to_vec(),
    }
}

/// The registers of a layout by their offset: their names there (there may be several for one),
/// and the bits that have a meaning.
fn registers(ir: &IR, layout: &Layout, base: u32, into: &mut BTreeMap<u32, (Vec<String>, u32)>) {
    let find = |name: &str| ir.blocks.iter().find(|block| block.name == name);
    if let Some(parent) = layout.extends.and_then(find) {
        registers(ir, parent, base, into);
    }
    for item in layout.items {
        let places = places(&item.array);
        for (index, place) in places.iter().enumerate() {
            let at = base + item.byte_offset + place;
            match &item.inner {
                BlockItemInner::Block(inner) => {
                    if let Some(block) = find(inner.block) {
                        let mut below = BTreeMap::new();
                        registers(ir, block, at, &mut below);
                        for (at, (names, bits)) in below {
                            let entry = into.entry(at).or_default();
                            let numbered = names.iter().map(|name| format!("{name}{}", index + 1));
                            entry.0.extend(numbered);
                            entry.1 |= bits;
                        }
                    }
                }
                BlockItemInner::Register(register) => {
                    let entry = into.entry(at).or_default();
                    let name = item.name.to_uppercase();
                    if places.len() > 1 {
                        // Numbered from 0 or 1, or by letters.
                        entry.0.push(format!("{name}{index}"));
                        entry.0.push(format!("{name}{}", index + 1));
                        entry.0.push(format!("{name}{}", ["L", "H"][index.min(1)]));
                    } else {
                        entry.0.push(name);
                    }
                    entry.1 |= register.fieldset.map_or(u32::MAX, |set| bits(ir, set));
                }
            }
        }
    }
}

/// The bits of a set of fields.
fn bits(ir: &IR, name: &str) -> u32 {
    let Some(set) = ir.fieldsets.iter().find(|set| set.name == name) else {
        return u32::MAX;
    };
    let mut all = set.extends.map_or(0, |parent| bits(ir, parent));
    for field in set.fields {
        let ranges = match &field.bit_offset {
            BitOffset::Regular(at) => vec![at.offset..=at.offset + field.bit_size - 1],
            BitOffset::Cursed(at) => at.ranges.to_vec(),
        };
        for place in places(&field.array) {
            for bit in ranges.iter().cloned().flatten() {
                all |= 1_u32.checked_shl(bit + place).unwrap_or(0);
            }
        }
    }
    all
}

fn layout(peripheral: &Peripheral) -> Result<BTreeMap<u32, (Vec<String>, u32)>, String> {
    let found = peripheral.registers.as_ref().ok_or("no registers")?;
    let plain = |name: &str| name.replace('_', "").to_lowercase();
    let mut blocks = found.ir.blocks.iter();
    let block = blocks.find(|b| plain(b.name) == plain(found.block));
    let mut all = BTreeMap::new();
    registers(
        found.ir,
        block.ok_or_else(|| format!("no layout {}", found.block))?,
        0,
        &mut all,
    );
    Ok(all)
}

/// Registers are where ST has them, under the names that ST gives them.
#[test]
fn registers_are_at_their_addresses() -> Outcome {
    let mut differences = Vec::new();
    for (name, registers, prefix) in MODELLED {
        let peripheral = peripheral(name)?;
        let known = layout(peripheral)?;
        let base = u32::try_from(peripheral.address)?;
        for (offset, register) in registers {
            let short = register.trim_start_matches(prefix);
            let other = other_name(short);
            match known.get(offset) {
                Some((names, _)) if names.contains(&other) => {}
                other => differences.push(format!("{name} {offset:#x} {short}: {other:?}")),
            }
            let address = base + offset;
            let found = Block::at(address).map(|(block, offset)| block.register(offset));
            let expected = format!("{name}_{short}");
            if found.as_ref() != Some(&expected) {
                differences.push(format!("{expected} at {address:#010x}: {found:?}"));
            }
        }
    }
    assert!(differences.is_empty(), "{}", differences.join("\n"));
    Ok(())
}

/// A bit that can be written has a meaning. RM0433 has two that the crate lacks: LATENCY of
/// FLASH_ACR has four bits, and the upper four of PWR_CR1 are ones that a program writes back.
#[test]
fn bits_that_can_be_written_exist() -> Outcome {
    let mut differences = Vec::new();
    for (name, registers, _) in MODELLED {
        let peripheral = peripheral(name)?;
        let known = layout(peripheral)?;
        let base = u32::try_from(peripheral.address)?;
        for (offset, register) in registers {
            let Some((_, meant)) = known.get(offset) else {
                continue;
            };
            let mut accepted = 0;
            for bit in 0..32 {
                let mut bus = Bus::new(Cost::DEFAULT);
                if let Some(rcc) = &peripheral.rcc
                    && let Some(enable) = &rcc.enable
                {
                    let (at, mask) = field(enable.register, enable.field)?;
                    bus.write(
                        u32::try_from(self::peripheral("RCC")?.address)? + at,
                        4,
                        mask,
                    );
                }
                assert_eq!(bus.error, None);
                bus.write(base + offset, 4, 1 << bit);
                accepted |= u32::from(bus.error.is_none()) << bit;
            }
            let beyond = accepted & !meant;
            // One that takes every word does nothing with it (read-only, locked), or with the
            // other bits (data, flags to clear).
            if beyond != 0 && accepted != u32::MAX {
                differences.push((*register, beyond));
            }
        }
    }
    let expected = [("FLASH_ACR", 1 << 3), ("PWR_CR1", 0xF000_0000)];
    assert_eq!(differences, expected);
    Ok(())
}

/// Offset and bits of a field of RCC.
fn field(register: &str, name: &str) -> Result<(u32, u32), String> {
    let registers = peripheral("RCC")?.registers.as_ref().ok_or("no RCC")?;
    let ir = registers.ir;
    let item = ir.blocks.iter().flat_map(|block| block.items);
    let item = item
        .filter(|item| item.name.eq_ignore_ascii_case(register))
        .min_by_key(|item| item.byte_offset)
        .ok_or_else(|| format!("no {register}"))?;
    let BlockItemInner::Register(inner) = &item.inner else {
        return Err(format!("{register} is no register"));
    };
    let set = ir
        .fieldsets
        .iter()
        .find(|set| Some(set.name) == inner.fieldset);
    let field = set.into_iter().flat_map(|set| set.fields);
    let field = field
        .into_iter()
        .find(|field| field.name.eq_ignore_ascii_case(name))
        .ok_or_else(|| format!("no {register}.{name}"))?;
    match &field.bit_offset {
        BitOffset::Regular(at) => Ok((item.byte_offset, 1 << at.offset)),
        BitOffset::Cursed(_) => Err(format!("{register}.{name}")),
    }
}

/// Without its clock's bit a peripheral does not answer, with it it does.
#[test]
fn clocks_have_their_bits() -> Outcome {
    for (name, ..) in MODELLED {
        let peripheral = peripheral(name)?;
        let Some(enable) = peripheral.rcc.as_ref().and_then(|rcc| rcc.enable.as_ref()) else {
            continue;
        };
        let (at, mask) = field(enable.register, enable.field)?;
        let address = u32::try_from(peripheral.address)?
            + match name {
                // MODER, PWRCR: without an effect when read.
                name if name.starts_with("GPIO") => 0,
                "SYSCFG" => 0x2C,
                // SR and ISR.
                name if name.starts_with("SPI") => 0x14,
                "USART3" => 0x1C,
                _ => 0x10,
            };
        for (value, answers) in [(!mask, false), (mask, true)] {
            let mut bus = Bus::new(Cost::DEFAULT);
            bus.rcc.write(at, value & known_clocks(at), 0)?;
            bus.read(address, 4);
            assert_eq!(bus.error.is_none(), answers, "{name}: {:?}", bus.error);
        }
    }
    Ok(())
}

/// The bits of a register of clocks that the model has: those of the peripherals here.
fn known_clocks(at: u32) -> u32 {
    let fields = MODELLED.iter().filter_map(|(name, ..)| {
        let enable = peripheral(name).ok()?.rcc.as_ref()?.enable.as_ref()?;
        field(enable.register, enable.field).ok()
    });
    let here = fields.filter(|(offset, _)| *offset == at);
    here.fold(0, |all, (_, mask)| all | mask)
}

/// Interrupts have the numbers of the vector table.
#[test]
fn interrupts_have_their_numbers() {
    for (name, number) in [("TIM1_CC", tim1::CC_IRQ), ("USART3", usart::IRQ)] {
        let found = METADATA.interrupts.iter().find(|i| i.name == name);
        assert_eq!(found.map(|i| i.number), Some(u32::from(number)), "{name}");
    }
}

/// DMA's requests have the numbers of DMAMUX1's table.
#[test]
fn requests_have_their_numbers() -> Outcome {
    for (name, signal, number) in [("TIM1", "CH1", dma::TIM1_CH1), ("SPI3", "TX", dma::SPI3_TX)] {
        let all = peripheral(name)?.dma_channels;
        let found = all
            .iter()
            .find(|c| c.signal == signal && c.dmamux == Some("DMAMUX1"));
        assert_eq!(
            found.and_then(|c| c.request),
            Some(number),
            "{name} {signal}"
        );
    }
    Ok(())
}

/// The wired pins can have the functions that the board uses.
#[test]
fn pins_have_their_functions() -> Outcome {
    for (name, signal, pin, function) in [
        ("TIM1", "CH1", pins::CONVST, 1),
        ("TIM1", "CH3", pins::LDAC, 1),
        ("SPI4", "SCK", pins::ADC_SCLK, 5),
        ("SPI4", "NSS", pins::CS, 5),
        ("SPI4", "MISO", pins::DOUTA, 5),
        ("SPI5", "SCK", pins::DOUTB_SCLK, 5),
        ("SPI5", "MOSI", pins::DOUTB, 5),
        ("SPI3", "NSS", pins::SYNC, 6),
        ("SPI3", "SCK", pins::DAC_SCLK, 6),
        ("SPI3", "MOSI", pins::SDI, 6),
        ("SPI3", "MISO", pins::SDO, 6),
        ("USART3", "TX", pins::LINK_TX, 7),
        ("USART3", "RX", pins::LINK_RX, 7),
    ] {
        let Pin(port, number) = pin;
        let text = format!("P{}{number}", char::from(b'A' + port));
        let all = peripheral(name)?.pins;
        let found = all.iter().find(|p| p.pin == text && p.signal == signal);
        assert_eq!(
            found.and_then(|p| p.af),
            Some(function),
            "{name} {signal} at {text}"
        );
    }
    Ok(())
}
