//! A program as instructions on a few registers, for the inner loops: what a formula that is only known at run time costs there.
//!
//! The same operations in the same order as [`crate::numerics::symbolic::Program::run`], on any number type. Numbers that several instructions
//! need stay in registers; sums and products with a constant hold it themselves.

use crate::numerics::real::{Real, Task};
use crate::numerics::symbolic::{Operation, Program};

/// Outputs at most.
pub const OUTPUTS: usize = 5;
/// Registers of a short program, and of any.
const FEW: usize = 8;
const MANY: usize = 32;

/// What an instruction does with its operands `a`, `b`, `c` and its number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    Constant,
    Add,
    AddNumber,
    Sub,
    Mul,
    MulNumber,
    Div,
    Neg,
    Sqrt,
    /// Sine into the register, cosine into register `b`.
    SinCos,
    Exp,
    Ln,
    Tanh,
    Abs,
    IfPositive,
}

#[derive(Debug, Clone, Copy)]
struct Step {
    what: What,
    out: u8,
    a: u8,
    b: u8,
    c: u8,
    number: f64,
}

/// A program for the inner loops.
#[derive(Debug, Clone)]
pub struct Bytecode {
    steps: Vec<Step>,
    outputs: Vec<u8>,
    inputs: Vec<Option<u8>>,
    registers: usize,
}

/// What a program is asked for: its inputs.
pub trait Inputs<T> {
    /// Writes the inputs to their registers, see [`Bytecode::register`]. Implementations are `#[inline(always)]`.
    fn fill(&self, registers: &mut [T]);
}

impl Bytecode {
    /// The instructions of a program; none where it has more than [`OUTPUTS`] outputs or needs more than 32 registers at once.
    pub fn of(program: &Program) -> Option<Self> {
        if program.outputs.len() > OUTPUTS {
            return None;
        }
        Allocation::new(program).all()
    }

    /// The register in which an input is expected; none where the program does not use it.
    pub fn register(&self, input: usize) -> Option<u8> {
        self.inputs.get(input).copied().flatten()
    }

    /// The outputs; those that the program does not have are zero.
    #[inline(always)]
    pub fn run<T: Real, I: Inputs<T>>(&self, inputs: I) -> [T; OUTPUTS] {
        if self.registers <= FEW { self.on::<T, I, FEW>(inputs) } else { self.on::<T, I, MANY>(inputs) }
    }

    /// The inputs are written where they are known. The instructions stand once for each type of number, whoever asks.
    #[inline(always)]
    fn on<T: Real, I: Inputs<T>, const R: usize>(&self, inputs: I) -> [T; OUTPUTS] {
        let mut x = [T::zero(); R];
        inputs.fill(&mut x);
        T::apart(Run { code: self, x: &mut x })
    }
}

/// A run of a program on `R` registers, a power of two, which hold the inputs.
struct Run<'a, T, const R: usize> {
    code: &'a Bytecode,
    x: &'a mut [T; R],
}

impl<T: Real, const R: usize> Task<T> for Run<'_, T, R> {
    type Output = [T; OUTPUTS];
    #[inline(always)]
    fn run(self) -> [T; OUTPUTS] {
        let x = self.x;
        // No register lies beyond the mask; with it no access needs a look at the length.
        let at = const { R - 1 };
        for step in &self.code.steps {
            let (a, b) = (step.a as usize & at, step.b as usize & at);
            let value = match step.what {
                What::Constant => T::constant(step.number),
                What::Add => x[a] + x[b],
                What::AddNumber => x[a] + step.number,
                What::Sub => x[a] - x[b],
                What::Mul => x[a] * x[b],
                What::MulNumber => x[a] * step.number,
                What::Div => x[a] / x[b],
                What::Neg => -x[a],
                What::Sqrt => x[a].sqrt(),
                What::SinCos => {
                    let (sin, cos) = x[a].sin_cos();
                    x[b] = cos;
                    sin
                }
                What::Exp => x[a].exp(),
                What::Ln => x[a].ln(),
                What::Tanh => x[a].tanh(),
                What::Abs => x[a].abs(),
                What::IfPositive => x[a].if_positive(x[b], x[step.c as usize & at]),
            };
            x[step.out as usize & at] = value;
        }
        let mut outputs = [T::zero(); OUTPUTS];
        for (output, place) in outputs.iter_mut().zip(&self.code.outputs) {
            *output = x[*place as usize & at];
        }
        outputs
    }
}

/// Registers given to the operations of a program: each from where it is computed to where it is last used.
struct Allocation<'a> {
    program: &'a Program,
    /// Where each operation is used last.
    last: Vec<usize>,
    /// The register of each operation that has one.
    register: Vec<Option<u8>>,
    free: Vec<bool>,
    steps: Vec<Step>,
}

impl<'a> Allocation<'a> {
    fn new(program: &'a Program) -> Self {
        let count = program.operations.len();
        let mut last: Vec<usize> = (0..count).collect();
        for (place, operation) in program.operations.iter().enumerate() {
            operation.operands().into_iter().for_each(|a| last[a] = place);
        }
        program.outputs.iter().for_each(|(_, place)| last[*place] = count);
        Self { program, last, register: vec![None; count], free: vec![true; MANY], steps: Vec::new() }
    }

    fn all(mut self) -> Option<Bytecode> {
        let inputs = self.inputs()?;
        for place in 0..self.program.operations.len() {
            self.next(place)?;
        }
        let outputs: Option<Vec<u8>> =
            self.program.outputs.iter().map(|(_, place)| self.operand(*place)).collect();
        let outputs = outputs?;
        let used = self.steps.iter().flat_map(|s| match s.what {
            What::SinCos => [s.out, s.b],
            _ => [s.out, s.out],
        });
        let most = used.chain(inputs.iter().copied().flatten()).max();
        let registers = most.map_or(0, |most| usize::from(most) + 1);
        Some(Bytecode { steps: self.steps, outputs, inputs, registers })
    }

    /// Registers of the inputs, which are there from the beginning.
    fn inputs(&mut self) -> Option<Vec<Option<u8>>> {
        let mut inputs = vec![None; self.program.inputs.len()];
        for (place, operation) in self.program.operations.iter().enumerate() {
            if let Operation::Input(k) = operation {
                let register = self.take()?;
                self.register[place] = Some(register);
                inputs[*k] = Some(register);
            }
        }
        Some(inputs)
    }

    fn take(&mut self) -> Option<u8> {
        let place = self.free.iter().position(|free| *free)?;
        self.free[place] = false;
        u8::try_from(place).ok()
    }

    /// Frees the register of an operation behind its last use.
    fn release(&mut self, operand: usize, place: usize) {
        if self.last[operand] <= place
            && let Some(register) = self.register[operand]
        {
            self.free[usize::from(register)] = true;
        }
    }

    fn constant(&self, place: usize) -> Option<f64> {
        match self.program.operations[place] {
            Operation::Constant(x) => Some(x),
            _ => None,
        }
    }

    /// The register that holds an operand. Constants are loaded where they are first needed.
    fn operand(&mut self, operand: usize) -> Option<u8> {
        if self.register[operand].is_none() {
            let out = self.take()?;
            self.register[operand] = Some(out);
            let number = self.constant(operand)?;
            self.steps.push(Step { what: What::Constant, out, a: 0, b: 0, c: 0, number });
        }
        self.register[operand]
    }

    /// The instruction of the operation at a place.
    fn next(&mut self, place: usize) -> Option<()> {
        let operation = self.program.operations[place];
        if self.register[place].is_some() {
            // The cosine of an angle whose sine came first, or the other way round.
            operation.operands().into_iter().for_each(|a| self.release(a, place));
            return Some(());
        }
        let plain = |what| (what, 0.0);
        let ((what, number), operands) = match operation {
            Operation::Constant(_) | Operation::Input(_) => return Some(()),
            Operation::Sin(a) | Operation::Cos(a) => return self.turned(place, a),
            Operation::Add(a, b) => match (self.constant(a), self.constant(b)) {
                (_, Some(x)) => ((What::AddNumber, x), vec![a]),
                (Some(x), _) => ((What::AddNumber, x), vec![b]),
                _ => (plain(What::Add), vec![a, b]),
            },
            Operation::Sub(a, b) => match self.constant(b) {
                Some(x) => ((What::AddNumber, -x), vec![a]),
                None => (plain(What::Sub), vec![a, b]),
            },
            Operation::Mul(a, b) => match (self.constant(a), self.constant(b)) {
                (_, Some(x)) => ((What::MulNumber, x), vec![a]),
                (Some(x), _) => ((What::MulNumber, x), vec![b]),
                _ => (plain(What::Mul), vec![a, b]),
            },
            Operation::Div(a, b) => (plain(What::Div), vec![a, b]),
            Operation::Neg(a) => (plain(What::Neg), vec![a]),
            Operation::Sqrt(a) => (plain(What::Sqrt), vec![a]),
            Operation::Exp(a) => (plain(What::Exp), vec![a]),
            Operation::Ln(a) => (plain(What::Ln), vec![a]),
            Operation::Tanh(a) => (plain(What::Tanh), vec![a]),
            Operation::Abs(a) => (plain(What::Abs), vec![a]),
            Operation::IfPositive(a, b, c) => (plain(What::IfPositive), vec![a, b, c]),
        };
        let mut registers = [0; 3];
        for (register, operand) in registers.iter_mut().zip(&operands) {
            *register = self.operand(*operand)?;
        }
        operation.operands().into_iter().for_each(|a| self.release(a, place));
        let out = self.take()?;
        self.register[place] = Some(out);
        let [a, b, c] = registers;
        self.steps.push(Step { what, out, a, b, c, number });
        Some(())
    }

    /// Sine and cosine of an angle by one instruction.
    fn turned(&mut self, place: usize, angle: usize) -> Option<()> {
        let other = match self.program.operations[place] {
            Operation::Sin(_) => Operation::Cos(angle),
            _ => Operation::Sin(angle),
        };
        let a = self.operand(angle)?;
        let (own, beside) = (self.take()?, self.take()?);
        self.register[place] = Some(own);
        match self.program.operations.iter().position(|operation| *operation == other) {
            Some(at) => self.register[at] = Some(beside),
            None => self.free[usize::from(beside)] = true,
        }
        let is_sine = matches!(other, Operation::Cos(_));
        let (out, b) = if is_sine { (own, beside) } else { (beside, own) };
        self.steps.push(Step { what: What::SinCos, out, a, b, c: 0, number: 0.0 });
        self.release(angle, place);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::dual::Dual;
    use crate::numerics::lanes::{self, Job, Lane, Path};
    use crate::numerics::real::testing::formula;
    use crate::numerics::symbolic::{Symbol, trace};

    struct Of<'a, T>(&'a Bytecode, &'a [T]);
    impl<T: Real> Inputs<T> for Of<'_, T> {
        #[inline(always)]
        fn fill(&self, registers: &mut [T]) {
            for (k, x) in self.1.iter().enumerate() {
                if let Some(place) = self.0.register(k) {
                    registers[usize::from(place)] = *x;
                }
            }
        }
    }

    fn program() -> Program {
        trace(vec!["x".into(), "y".into()], |x| {
            let (s, c) = (x[0] * 3.0).sin_cos();
            let both = [formula(x[0], x[1]), s - c * x[1], c, Symbol::constant(2.0) - x[1], x[0]];
            both.into_iter().map(|f| (String::new(), f)).collect()
        })
    }

    #[test]
    fn instructions_have_the_bits_of_the_program_on_numbers_and_on_vectors() {
        let program = program();
        let code = Bytecode::of(&program).unwrap();
        assert!(code.registers <= 16, "{}", code.registers);
        struct Lanes<'a>(&'a Bytecode, f64, f64);
        impl Job for Lanes<'_> {
            type Output = Vec<f64>;
            #[inline(always)]
            fn run<V: Lane>(self) -> Vec<f64> {
                let out = self.0.run(Of(self.0, &[V::constant(self.1), V::constant(self.2)]));
                out.iter().map(|x| x.first()).collect()
            }
        }
        for (x, y) in [(0.7, -1.3), (-0.4, 0.2), (0.2, 2.0)] {
            let expected = program.run(&[x, y]);
            let got: [f64; OUTPUTS] = code.run(Of(&code, &[x, y]));
            assert_eq!(
                got.map(f64::to_bits).to_vec(),
                expected.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
            );
            for path in Path::ALL {
                let lanes = lanes::reproducible(path, Lanes(&code, x, y));
                for (a, b) in lanes.iter().zip(&expected) {
                    assert!((a - b).abs() <= 4.0 * f64::EPSILON * b.abs().max(1.0), "{path:?} {a} {b}");
                }
            }
            let dual = code.run(Of(&code, &[Dual::<2>::variable(x, 0), Dual::variable(y, 1)]));
            let direct = formula(Dual::<2>::variable(x, 0), Dual::variable(y, 1));
            for k in 0..2 {
                assert!((dual[0].eps[k] - direct.eps[k]).abs() < 1e-13 * direct.eps[k].abs().max(1.0));
            }
        }
    }

    #[test]
    fn a_program_that_needs_too_many_numbers_at_once_is_refused() {
        let long = trace((0..40).map(|k| format!("x{k}")).collect(), |x| {
            let products: Vec<Symbol> = x.iter().map(|a| *a * x[0]).collect();
            let sum = products.iter().rev().fold(x[1].exp(), |sum, p| sum.tanh() * *p);
            vec![("f".into(), x.iter().fold(sum, |sum, a| sum + *a))]
        });
        assert!(Bytecode::of(&long).is_none());
    }
}
