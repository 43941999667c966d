//! Unicorn, and what its callbacks share with the machine.
//!
//! The callbacks are registered through unicorn's C interface: the closures of
//! `unicorn-engine` count a reference up and down at each call, and there is a call for
//! every instruction and every access to a register.

use std::ffi::c_void;
use std::ops::{Deref, DerefMut, RangeInclusive};
use std::ptr::NonNull;

use unicorn_engine::hook::{sys, uc_engine};
use unicorn_engine::{
    Arch, ArmCpuModel, HookType, MemType, Mode, RegisterARM as Reg, TlbEntry, TlbType, Unicorn,
    uc_error,
};

use super::State;

/// The emulator with the state of the board.
pub(super) struct Emulator {
    uc: Unicorn<'static, ()>,
    /// Owned; the callbacks have its address.
    state: NonNull<State>,
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // SAFETY: it comes from a box, and nothing runs any more that could call back. The
        // emulator, which is dropped after it, does not touch the memories it knows.
        drop(unsafe { Box::from_raw(self.state.as_ptr()) });
    }
}

impl Deref for Emulator {
    type Target = Unicorn<'static, ()>;

    fn deref(&self) -> &Self::Target {
        &self.uc
    }
}

impl DerefMut for Emulator {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.uc
    }
}

impl Emulator {
    /// A Cortex-M7 without memory.
    pub fn new(state: State) -> Result<Self, String> {
        let mode = Mode::LITTLE_ENDIAN | Mode::THUMB;
        let mut uc = Unicorn::new(Arch::ARM, mode).map_err(failed("start"))?;
        uc.ctl_set_cpu_model(ArmCpuModel::CORTEX_M7 as i32)
            .map_err(failed("model"))?;
        // No address ends the run, not even 0, where code is.
        uc.ctl_exits_enable().map_err(failed("exits"))?;
        Ok(Self {
            uc,
            state: NonNull::from(Box::leak(Box::new(state))),
        })
    }

    pub fn state(&self) -> &State {
        // SAFETY: it lives as long as this, and callbacks, which change it, run only in
        // `emu_start`, which borrows the emulator as mutable.
        unsafe { self.state.as_ref() }
    }

    pub fn state_mut(&mut self) -> &mut State {
        // SAFETY: as above.
        unsafe { self.state.as_mut() }
    }

    pub fn core(&self) -> Core {
        Core(self.uc.get_handle())
    }

    /// Calls `hook` before every instruction, with its address.
    pub fn before_instructions(&mut self, hook: CodeHook) -> Result<(), String> {
        self.add(HookType::CODE, 0..=u32::MAX, hook as *mut c_void)
    }

    /// Calls `hook` for a memory access at one of these addresses that cannot be carried
    /// out. With such a hook, whether called or not, unicorn takes a long way for every
    /// write there.
    pub fn at_bad_accesses(
        &mut self,
        addresses: RangeInclusive<u32>,
        hook: MemoryHook,
    ) -> Result<(), String> {
        self.add(HookType::MEM_INVALID, addresses, hook as *mut c_void)
    }

    /// Calls `hook` for a page's translation, when it is used for the first time and
    /// sometimes again.
    pub fn at_new_pages(&mut self, hook: PageHook) -> Result<(), String> {
        self.uc
            .ctl_set_tlb_type(TlbType::VIRTUAL)
            .map_err(failed("pages"))?;
        self.add(HookType::TLB_FILL, 0..=u32::MAX, hook as *mut c_void)
    }

    /// Calls `hook` when the core raises an exception by itself.
    pub fn at_traps(&mut self, hook: TrapHook) -> Result<(), String> {
        self.add(HookType::INTR, 0..=u32::MAX, hook as *mut c_void)
    }

    fn add(
        &mut self,
        kind: HookType,
        addresses: RangeInclusive<u32>,
        callback: *mut c_void,
    ) -> Result<(), String> {
        let mut id = 0;
        // SAFETY: the callback has the type that unicorn wants for this kind, by the types
        // of the functions above; it gets the state, which outlives all runs.
        let outcome = unsafe {
            sys::uc_hook_add(
                self.uc.get_handle(),
                &raw mut id,
                kind.0 as i32,
                callback,
                self.state.as_ptr().cast(),
                u64::from(*addresses.start()),
                u64::from(*addresses.end()),
            )
        };
        done(outcome, "hooks")
    }

    /// Calls `read` and `write` for accesses to a range of addresses.
    pub fn callback(
        &mut self,
        (start, size): (u32, u32),
        read: ReadCallback,
        write: WriteCallback,
    ) -> Result<(), String> {
        let state: *mut c_void = self.state.as_ptr().cast();
        // SAFETY: as for hooks.
        let outcome = unsafe {
            sys::uc_mmio_map(
                self.uc.get_handle(),
                u64::from(start),
                u64::from(size),
                Some(read),
                state,
                Some(write),
                state,
            )
        };
        done(outcome, "callbacks")
    }
}

type CodeHook = unsafe extern "C" fn(*mut uc_engine, u64, u32, *mut c_void);
type MemoryHook = unsafe extern "C" fn(*mut uc_engine, MemType, u64, i32, i64, *mut c_void) -> bool;
type PageHook =
    unsafe extern "C" fn(*mut uc_engine, u64, MemType, *mut TlbEntry, *mut c_void) -> bool;
type TrapHook = unsafe extern "C" fn(*mut uc_engine, u32, *mut c_void);
type ReadCallback = unsafe extern "C" fn(*mut uc_engine, u64, u32, *mut c_void) -> u64;
type WriteCallback = unsafe extern "C" fn(*mut uc_engine, u64, u32, u64, *mut c_void);

/// The state that a callback was registered with.
///
/// # Safety
/// To be called by the callbacks of an [`Emulator`] with their data alone, once in each.
pub(super) unsafe fn state<'a>(data: *mut c_void) -> &'a mut State {
    // SAFETY: it is the address of the emulator's state. While the emulator runs, nothing
    // else refers to it, and unicorn does not call back in a callback.
    unsafe { &mut *data.cast() }
}

/// The core, as a callback has it.
#[derive(Clone, Copy)]
pub(crate) struct Core(*mut uc_engine);

impl Core {
    /// The core that a callback was called for.
    pub(super) fn of(uc: *mut uc_engine) -> Self {
        Self(uc)
    }

    /// A register.
    pub(crate) fn get(self, register: Reg) -> u64 {
        let mut value = 0;
        // SAFETY: the engine lives; the value has room for every register of this core.
        // The call cannot fail for one of them.
        unsafe { sys::uc_reg_read(self.0, register as i32, (&raw mut value).cast()) };
        value
    }

    /// EPSR says that no IT block is under way, as it does while translated code runs.
    pub(super) fn leave_it_block(self) {
        let value = 1_u32 << 24;
        // SAFETY: the engine lives, and reads 32 bits. The call cannot fail.
        unsafe { sys::uc_reg_write(self.0, Reg::EPSR as i32, (&raw const value).cast()) };
    }

    /// Ends the run before the next instruction.
    pub(super) fn stop(self) {
        // SAFETY: the engine lives. The call cannot fail while it runs.
        unsafe { sys::uc_emu_stop(self.0) };
    }
}

fn done(outcome: uc_error, what: &'static str) -> Result<(), String> {
    match outcome {
        uc_error::OK => Ok(()),
        error => Err(failed(what)(error)),
    }
}

/// Says what failed.
pub(super) fn failed(what: &'static str) -> impl Fn(uc_error) -> String {
    move |error| format!("the emulator: {what}: {error:?}")
}
