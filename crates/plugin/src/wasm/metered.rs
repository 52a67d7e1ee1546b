//! Modules rewritten to keep to their limits by themselves, for hosts that see to none of them, as a browser.
//!
//! What comes out counts its instructions as wasmtime does and where it does, so that fuel is used up at the same
//! step; gives whatever is not a number the pattern of bits that wasmtime gives it; and traps where it would
//! grow beyond its room. Instructions are copied as they are, with others put between them.

use std::collections::BTreeMap;
use std::ops::Range;

use wasmparser::{
    CompositeInnerType, ExternalKind, FuncType, FunctionBody, Operator, Parser, Payload, TypeRef,
    ValType, Validator, WasmFeatures,
};

use super::mathematics::{OF_ONE, OF_TWO};
use super::{TABLE_MAX, out_of_memory, out_of_table, stranger, uncompiled};
use crate::contract::Fault;

/// The global by which the host gives fuel, and sees what is left.
pub(super) const FUEL: &str = "fuel of the host";
/// What it holds when there is none left, or more memory or a larger table was asked for.
pub(super) const OUT_OF_FUEL: i64 = i64::MIN;
pub(super) const OUT_OF_MEMORY: i64 = i64::MIN + 1;
pub(super) const OUT_OF_TABLE: i64 = i64::MIN + 2;

/// What is the same everywhere. Vectors that may be computed in several ways are not.
const FEATURES: WasmFeatures = WasmFeatures::WASM2
    .union(WasmFeatures::EXTENDED_CONST)
    .union(WasmFeatures::TAIL_CALL);
/// Bytes of a page of memory.
const PAGE: u64 = 1 << 16;
/// A bulk of so many bytes or entries, if it is known to be no larger, is no reason to look at the fuel.
const BULK_SMALL: i64 = 128;
/// Sections by their numbers.
const GLOBALS: u8 = 6;
const EXPORTS: u8 = 7;
const CODE: u8 = 10;

/// A module that keeps to its limits.
pub(super) struct Metered {
    pub bytes: Vec<u8>,
    /// Types of the functions that it exports.
    #[cfg_attr(not(target_family = "wasm"), allow(dead_code))]
    pub functions: BTreeMap<String, FuncType>,
}

/// Rewrites a module that may have so much memory, MiB, and so much fuel until it has begun.
pub(super) fn metered(bytes: &[u8], memory: u64, fuel_of_start: u64) -> Result<Metered, Fault> {
    let refuse = |error: wasmparser::BinaryReaderError| uncompiled(&error.to_string());
    Validator::new_with_features(FEATURES)
        .validate_all(bytes)
        .map_err(refuse)?;
    let mut module = Module {
        from: bytes,
        bytes: bytes[..8].to_vec(),
        pages: memory.saturating_mul((1 << 20) / PAGE),
        fuel_of_start: tank(fuel_of_start),
        ..Module::default()
    };
    for payload in Parser::new(0).parse_all(bytes) {
        module.take(payload.map_err(refuse)?, memory)?;
    }
    Ok(Metered {
        bytes: module.bytes,
        functions: module.exported,
    })
}

/// What the global holds for so much fuel.
pub(super) fn tank(fuel: u64) -> i64 {
    i64::try_from(fuel).unwrap_or(i64::MAX)
}

/// What is known of a module, and what of it is written.
#[derive(Default)]
struct Module<'a> {
    from: &'a [u8],
    bytes: Vec<u8>,
    /// Most pages of memory.
    pages: u64,
    fuel_of_start: i64,
    types: Vec<FuncType>,
    /// Types of its functions; those that it imports come first.
    functions: Vec<u32>,
    imports: usize,
    /// Place of the global that holds the fuel.
    fuel: u32,
    has_globals: bool,
    exported: BTreeMap<String, FuncType>,
    bodies: usize,
    code: Vec<u8>,
}

impl<'a> Module<'a> {
    fn take(&mut self, payload: Payload<'a>, memory: u64) -> Result<(), Fault> {
        let refuse = |error: wasmparser::BinaryReaderError| uncompiled(&error.to_string());
        let section = payload.as_section();
        match payload {
            Payload::TypeSection(types) => {
                for group in types {
                    for kind in group.map_err(refuse)?.into_types() {
                        let CompositeInnerType::Func(function) = kind.composite_type.inner else {
                            return Err(uncompiled("types must be of functions"));
                        };
                        self.types.push(function);
                    }
                }
            }
            Payload::ImportSection(imports) => {
                for import in imports.into_imports() {
                    let import = import.map_err(refuse)?;
                    let TypeRef::Func(kind) = import.ty else {
                        return Err(stranger(import.module, import.name));
                    };
                    let known = numbers_of(import.name).filter(|_| import.module == "env");
                    let function = &self.types[kind as usize];
                    let fits = |count| {
                        *function.params() == vec![ValType::F64; count]
                            && *function.results() == [ValType::F64]
                    };
                    if !known.is_some_and(fits) {
                        return Err(stranger(import.module, import.name));
                    }
                    self.functions.push(kind);
                    self.imports += 1;
                }
            }
            Payload::FunctionSection(functions) => {
                for kind in functions {
                    self.functions.push(kind.map_err(refuse)?);
                }
            }
            Payload::TableSection(tables) => {
                for table in tables {
                    if table.map_err(refuse)?.ty.initial > u64::from(TABLE_MAX) {
                        return Err(Fault::new("start", out_of_table()));
                    }
                }
            }
            Payload::MemorySection(memories) => {
                for kind in memories {
                    if kind.map_err(refuse)?.initial > self.pages {
                        return Err(Fault::new("start", out_of_memory(memory)));
                    }
                }
            }
            Payload::GlobalSection(globals) => {
                self.fuel = globals.count();
                let own = globals.original_position()..globals.range().end;
                self.globals(own);
                return Ok(());
            }
            Payload::ExportSection(exports) => {
                if !self.has_globals {
                    self.globals(0..0);
                }
                let own = exports.original_position()..exports.range().end;
                let mut section = Vec::new();
                unsigned(&mut section, u64::from(exports.count()) + 1);
                section.extend(&self.from[own]);
                text(&mut section, FUEL);
                section.push(3);
                unsigned(&mut section, self.fuel.into());
                self.section(EXPORTS, &section);
                for export in exports {
                    let export = export.map_err(refuse)?;
                    if export.kind == ExternalKind::Func {
                        let kind = self.functions[export.index as usize] as usize;
                        let name = export.name.to_owned();
                        self.exported.insert(name, self.types[kind].clone());
                    }
                }
                return Ok(());
            }
            Payload::CodeSectionStart { count, .. } => {
                unsigned(&mut self.code, count.into());
                return Ok(());
            }
            Payload::CodeSectionEntry(body) => {
                let kind = self.functions[self.imports + self.bodies] as usize;
                let parameters = self.types[kind].params().len();
                let body = Body::rewrite(self, &body, parameters).map_err(refuse)?;
                unsigned(&mut self.code, body.len() as u64);
                self.code.extend(body);
                self.bodies += 1;
                if self.imports + self.bodies == self.functions.len() {
                    let code = std::mem::take(&mut self.code);
                    self.section(CODE, &code);
                }
                return Ok(());
            }
            // Names and the like.
            Payload::CustomSection(_) => return Ok(()),
            _ => {}
        }
        if let Some((number, range)) = section {
            let from = self.from;
            self.section(number, &from[range]);
        }
        Ok(())
    }

    fn section(&mut self, number: u8, content: &[u8]) {
        self.bytes.push(number);
        unsigned(&mut self.bytes, content.len() as u64);
        self.bytes.extend(content);
    }

    /// Its globals, and one more.
    fn globals(&mut self, own: Range<usize>) {
        let mut section = Vec::new();
        unsigned(&mut section, u64::from(self.fuel) + 1);
        section.extend(&self.from[own]);
        // A variable of 64 bits, and what it holds at first.
        section.extend([0x7e, 1, 0x42]);
        signed(&mut section, self.fuel_of_start);
        section.push(0x0b);
        self.section(GLOBALS, &section);
        self.has_globals = true;
    }
}

/// How many numbers a function of mathematics takes.
fn numbers_of(name: &str) -> Option<usize> {
    let of_one = OF_ONE.iter().any(|(known, _)| *known == name);
    let of_two = OF_TWO.iter().any(|(known, _)| *known == name);
    match (of_one, of_two) {
        (true, _) => Some(1),
        (_, true) => Some(2),
        _ => None,
    }
}

/// What instructions leave that may be no number.
#[derive(Clone, Copy, Debug)]
enum Float {
    F32,
    F64,
    F32x4,
    F64x2,
}

/// What is kept aside for a moment, by the number of its type.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u8)]
enum Aside {
    I32 = 0x7f,
    F32 = 0x7d,
    F64 = 0x7c,
    V128 = 0x7b,
}

/// What an instruction computes, if it is no number whose bits the standard leaves open.
fn computed(operator: &Operator<'_>) -> Option<Float> {
    use Operator as O;
    Some(match operator {
        O::F32Ceil | O::F32Floor | O::F32Trunc | O::F32Nearest | O::F32Sqrt => Float::F32,
        O::F32Add | O::F32Sub | O::F32Mul | O::F32Div | O::F32Min | O::F32Max => Float::F32,
        O::F32DemoteF64 => Float::F32,
        O::F64Ceil | O::F64Floor | O::F64Trunc | O::F64Nearest | O::F64Sqrt => Float::F64,
        O::F64Add | O::F64Sub | O::F64Mul | O::F64Div | O::F64Min | O::F64Max => Float::F64,
        O::F64PromoteF32 => Float::F64,
        O::F32x4Ceil | O::F32x4Floor | O::F32x4Trunc | O::F32x4Nearest => Float::F32x4,
        O::F32x4Sqrt | O::F32x4Add | O::F32x4Sub | O::F32x4Mul | O::F32x4Div => Float::F32x4,
        O::F32x4Min | O::F32x4Max | O::F32x4DemoteF64x2Zero => Float::F32x4,
        O::F64x2Ceil | O::F64x2Floor | O::F64x2Trunc | O::F64x2Nearest => Float::F64x2,
        O::F64x2Sqrt | O::F64x2Add | O::F64x2Sub | O::F64x2Mul | O::F64x2Div => Float::F64x2,
        O::F64x2Min | O::F64x2Max | O::F64x2PromoteLowF32x4 => Float::F64x2,
        _ => return None,
    })
}

/// A function while it is rewritten.
struct Body {
    code: Vec<u8>,
    fuel: u32,
    pages: u64,
    /// Parameters and variables that it has.
    own: u32,
    /// Those that it gets.
    asides: Vec<Aside>,
    /// Instructions that are not counted yet.
    pending: i64,
}

impl Body {
    fn rewrite(
        module: &Module<'_>,
        body: &FunctionBody<'_>,
        parameters: usize,
    ) -> wasmparser::Result<Vec<u8>> {
        let variables = body.get_locals_reader()?;
        let groups = variables.get_count();
        let begin = variables.original_position();
        let mut own = parameters as u32;
        for group in variables {
            own += group?.0;
        }
        let operators = body.get_operators_reader()?;
        let groups_end = operators.original_position();
        let mut this = Body {
            code: Vec::new(),
            fuel: module.fuel,
            pages: module.pages,
            own,
            asides: Vec::new(),
            // A function costs something even if it does nothing.
            pending: 1,
        };
        this.count();
        this.check();
        let operators: Vec<_> = operators
            .into_iter_with_offsets()
            .collect::<wasmparser::Result<_>>()?;
        for (k, (operator, from)) in operators.iter().enumerate() {
            let to = operators.get(k + 1).map_or(body.range().end, |next| next.1);
            let before = k.checked_sub(1).map(|k| &operators[k].0);
            this.operator(operator, before, &module.from[*from..to]);
        }
        let mut whole = Vec::new();
        unsigned(&mut whole, u64::from(groups) + this.asides.len() as u64);
        whole.extend(&module.from[begin..groups_end]);
        for aside in &this.asides {
            whole.extend([1, *aside as u8]);
        }
        whole.extend(this.code);
        Ok(whole)
    }

    /// Writes an instruction, with what has to stand before and behind it.
    fn operator(&mut self, operator: &Operator<'_>, before: Option<&Operator<'_>>, bytes: &[u8]) {
        use Operator as O;
        self.pending += match operator {
            O::Nop | O::Drop | O::Block { .. } | O::Loop { .. } => 0,
            O::Unreachable | O::Return | O::Else | O::End => 0,
            _ => 1,
        };
        match operator {
            // Where it goes on elsewhere, or others come from elsewhere.
            O::Unreachable
            | O::Return
            | O::Call { .. }
            | O::CallIndirect { .. }
            | O::ReturnCall { .. }
            | O::ReturnCallIndirect { .. }
            | O::Loop { .. }
            | O::If { .. }
            | O::Br { .. }
            | O::BrIf { .. }
            | O::BrTable { .. }
            | O::Else
            | O::End => self.count(),
            O::MemoryGrow { .. } => self.grow(&[0x3f, 0], self.pages, OUT_OF_MEMORY),
            O::TableGrow { table } => {
                let mut size = vec![0xfc, 16];
                unsigned(&mut size, (*table).into());
                self.bulk(before);
                self.grow(&size, TABLE_MAX.into(), OUT_OF_TABLE);
            }
            O::MemoryCopy { .. }
            | O::MemoryFill { .. }
            | O::MemoryInit { .. }
            | O::TableCopy { .. }
            | O::TableFill { .. }
            | O::TableInit { .. } => self.bulk(before),
            _ => {}
        }
        self.code.extend(bytes);
        match operator {
            O::Loop { .. } => self.check(),
            _ => {
                if let Some(kind) = computed(operator) {
                    self.same(kind);
                }
            }
        }
    }

    /// Takes from the fuel what is not counted yet.
    fn count(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        if pending > 0 {
            self.get_fuel();
            self.constant(pending);
            self.code.push(0x7d); // i64.sub
            self.set_fuel();
        }
    }

    /// Ends the call if there is no fuel left.
    fn check(&mut self) {
        self.count();
        self.get_fuel();
        self.constant(0);
        self.code.push(0x57); // i64.le_s
        self.end_if(OUT_OF_FUEL);
    }

    /// Counts what is about to be done to as many bytes or entries as the number on top says.
    fn bulk(&mut self, before: Option<&Operator<'_>>) {
        if let Some(Operator::I32Const { value }) = before {
            let many = i64::from(*value as u32);
            self.pending += many;
            if many > BULK_SMALL {
                self.check();
            }
            return;
        }
        let many = self.aside(Aside::I32);
        self.code.push(0x22); // local.tee
        unsigned(&mut self.code, many);
        self.count();
        self.get_fuel();
        self.code.push(0x20); // local.get
        unsigned(&mut self.code, many);
        self.code.push(0xad); // i64.extend_i32_u
        self.code.push(0x7d); // i64.sub
        self.set_fuel();
        self.check();
    }

    /// Ends the call if the number on top is more than there is room for beside what `size` gives.
    fn grow(&mut self, size: &[u8], most: u64, why: i64) {
        let many = self.aside(Aside::I32);
        self.code.push(0x22); // local.tee
        unsigned(&mut self.code, many);
        self.code.push(0xad); // i64.extend_i32_u
        self.code.extend(size);
        self.code.push(0xad); // i64.extend_i32_u
        self.code.push(0x7c); // i64.add
        self.constant(i64::try_from(most).unwrap_or(i64::MAX));
        self.code.push(0x56); // i64.gt_u
        self.end_if(why);
        self.code.push(0x20); // local.get
        unsigned(&mut self.code, many);
    }

    /// Gives what is on top one pattern of bits where it is no number.
    fn same(&mut self, kind: Float) {
        let [nan, eq, choose]: [&[u8]; 3] = match kind {
            Float::F32 => [&[0x43], &[0x5b], &[0x1b]],
            Float::F64 => [&[0x44], &[0x61], &[0x1b]],
            Float::F32x4 => [&[0xfd, 0x0c], &[0xfd, 0x41], &[0xfd, 0x52]],
            Float::F64x2 => [&[0xfd, 0x0c], &[0xfd, 0x47], &[0xfd, 0x52]],
        };
        let number = self.aside(match kind {
            Float::F32 => Aside::F32,
            Float::F64 => Aside::F64,
            Float::F32x4 | Float::F64x2 => Aside::V128,
        });
        self.code.push(0x22); // local.tee
        unsigned(&mut self.code, number);
        self.code.extend(nan);
        match kind {
            Float::F32 => self.code.extend(f32::NAN.to_le_bytes()),
            Float::F64 => self.code.extend(f64::NAN.to_le_bytes()),
            Float::F32x4 => self
                .code
                .extend([f32::NAN; 4].map(f32::to_le_bytes).as_flattened()),
            Float::F64x2 => self
                .code
                .extend([f64::NAN; 2].map(f64::to_le_bytes).as_flattened()),
        }
        for _ in 0..2 {
            self.code.push(0x20); // local.get
            unsigned(&mut self.code, number);
        }
        // What equals itself is a number, and stays.
        self.code.extend(eq);
        self.code.extend(choose);
    }

    fn get_fuel(&mut self) {
        self.code.push(0x23); // global.get
        unsigned(&mut self.code, self.fuel.into());
    }

    fn set_fuel(&mut self) {
        self.code.push(0x24); // global.set
        unsigned(&mut self.code, self.fuel.into());
    }

    fn constant(&mut self, value: i64) {
        self.code.push(0x42); // i64.const
        signed(&mut self.code, value);
    }

    /// Ends the call if the number on top is not zero, and leaves word why.
    fn end_if(&mut self, why: i64) {
        self.code.extend([0x04, 0x40]); // if
        self.constant(why);
        self.set_fuel();
        self.code.extend([0x00, 0x0b]); // unreachable, end
    }

    /// The place of a variable of this type.
    fn aside(&mut self, kind: Aside) -> u64 {
        let known = self.asides.iter().position(|one| *one == kind);
        let place = known.unwrap_or_else(|| {
            self.asides.push(kind);
            self.asides.len() - 1
        });
        u64::from(self.own) + place as u64
    }
}

/// Writes a number as modules do: seven bits a byte.
fn unsigned(to: &mut Vec<u8>, mut value: u64) {
    while value > 0x7f {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8);
}

fn signed(to: &mut Vec<u8>, mut value: i64) {
    while !(-0x40..0x40).contains(&value) {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8 & 0x7f);
}

fn text(to: &mut Vec<u8>, text: &str) {
    unsigned(to, text.len() as u64);
    to.extend(text.as_bytes());
}

#[cfg(test)]
mod tests;
