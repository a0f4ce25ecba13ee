//! Solving quadratic programmes allocates nothing: counted by an allocator.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    hint::black_box,
    sync::atomic::{AtomicU64, Ordering},
};

use control_proc::predictive::quadratic::{Problem, Solver, Status};

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

/// The system's allocator, with a count of what is asked of it.
struct Counting;

// SAFETY: every call is passed on to the system's allocator as it came; counting touches no memory of the heap.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test, since the allocator counts for the whole process. The thread that runs it is the only one at work.
#[test]
fn a_thousand_solves_allocate_nothing() {
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    drop(black_box(vec![1u8; 100]));
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 2);

    const N: usize = 20;
    let mut solver = Solver::<N, N>::new();
    let mut hessian = [[0.0; N]; N];
    (0..N).for_each(|i| hessian[i][i..].iter_mut().for_each(|h| *h = 0.5));
    let (mut steps, mut refused) = (0, 0);
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    for k in 0..1000 {
        let mut problem: Problem<N, N> = Problem::new(hessian, [0.0; N]);
        for i in 0..N {
            problem.hessian[i][i] = 1.0 + 0.01 * ((k + i) % 7) as f64;
            problem.gradient[i] = 10.0 * ((k * N + i) as f64).sin();
            (problem.lower[i], problem.upper[i]) = (-1.0, 1.0);
            problem.rows[i][i] = 1.0;
            if i > 0 {
                problem.rows[i][i - 1] = -1.0;
            }
            (problem.row_lower[i], problem.row_upper[i]) = (-0.2, 0.2);
        }
        if k % 10 == 0 {
            // Out of what the rates allow.
            problem.lower[0] = 0.5;
        }
        let solution = black_box(solver.solve(black_box(&problem)));
        steps += solution.iterations;
        refused += usize::from(solution.status == Status::Infeasible);
    }
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0);
    assert!(steps > 1000 && refused == 100, "{steps} {refused}");
}
