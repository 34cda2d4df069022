//! Lattices on a graphics card, by `wgpu`: Vulkan, Metal or Direct3D 12.
//!
//! Three methods make the same steps: each point gathers its forces and then each moves (`point`); each spring
//! stores its force, and each point takes those of its springs (`edge`); forces and motion in one pass with two
//! sets of positions (`single`). None has atomic sums, so a device gives the same bits in every run. Devices differ:
//! WGSL permits them to fuse and to round.
//!
//! # Limitations
//! Numbers are displacements from rest in single precision ([`shader`]).

mod shader;

use std::borrow::Cow;
use std::sync::mpsc;

use wgpu::util::{BufferInitDescriptor, DeviceExt};

use super::measure::LatticeMotion;
use super::{Lattice, LatticeSettings, LatticeShape, Number};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum;

/// Steps of a submission: enough to hide what one costs, few enough to be heard.
const AT_ONCE: u64 = 64;

/// Bytes of a number.
const NUMBER: u64 = 4;

/// Why a card does not take a lattice, or stopped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum GpuError {
    /// There is no card, or no driver of one.
    #[error("there is no graphics device: {0}")]
    NoDevice(String),
    /// The card has too little memory.
    #[error("such a lattice needs {needed} bytes in one buffer, {name} takes {most}")]
    TooLarge {
        /// Bytes of the greatest buffer.
        needed: u64,
        /// Bytes that the card takes.
        most: u64,
        /// Name of the card.
        name: String,
    },
    /// The card refused or failed.
    #[error("{name}: {message}")]
    Failed {
        /// Name of the card.
        name: String,
        /// What it said.
        message: String,
    },
}

/// A card, ready to compute.
struct Card {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    most: u64,
}

impl Card {
    /// The card that the system prefers.
    fn first() -> Result<Self, GpuError> {
        let instance = wgpu::Instance::default();
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let no_device = |error: &dyn std::error::Error| GpuError::NoDevice(error.to_string());
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| no_device(&error))?;
        let (info, limits) = (adapter.get_info(), adapter.limits());
        // Its times say nothing about cards.
        let by = match info.device_type {
            wgpu::DeviceType::Cpu => ", a driver that computes on the processor",
            _ => "",
        };
        let most = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        let descriptor = wgpu::DeviceDescriptor {
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| no_device(&error))?;
        Ok(Self {
            device,
            queue,
            name: format!("{}, {}{by}", info.name, info.backend),
            most,
        })
    }

    fn failed(&self, message: impl ToString) -> GpuError {
        GpuError::Failed {
            name: self.name.clone(),
            message: message.to_string(),
        }
    }

    /// Does something of which the card can refuse parts: too much memory, or a kernel.
    fn checked<T>(&self, deed: impl FnOnce() -> T) -> Result<T, GpuError> {
        let scopes = [
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ]
        .map(|filter| self.device.push_error_scope(filter));
        let done = deed();
        let [memory, validation] = scopes;
        // The last one that was opened ends first.
        let errors = [validation, memory].map(|scope| pollster::block_on(scope.pop()));
        match errors.into_iter().flatten().next() {
            Some(error) => Err(self.failed(error)),
            None => Ok(done),
        }
    }

    fn buffer(&self, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage,
            mapped_at_creation: false,
        })
    }

    fn filled<T: bytemuck::Pod>(&self, with: &[T]) -> wgpu::Buffer {
        self.device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(with),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        })
    }

    /// Waits for a copy into a buffer, which was submitted as `copy`, and calls `deed` with its numbers.
    fn read<T>(
        &self,
        from: &wgpu::Buffer,
        copy: &wgpu::SubmissionIndex,
        deed: impl FnOnce(&[f32]) -> T,
    ) -> Result<T, GpuError> {
        let (done, ready) = mpsc::channel();
        from.map_async(wgpu::MapMode::Read, .., move |mapped| {
            // The other end is waiting below.
            let _ = done.send(mapped);
        });
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: Some(copy.clone()),
                timeout: None,
            })
            .map_err(|error| self.failed(error))?;
        ready
            .recv()
            .map_err(|error| self.failed(error))?
            .map_err(|error| self.failed(error))?;
        let found = {
            let view = from
                .get_mapped_range(..)
                .map_err(|error| self.failed(error))?;
            deed(bytemuck::cast_slice(&view))
        };
        from.unmap();
        Ok(found)
    }
}

/// A pass of a step: a kernel, and the workgroups along z.
struct Pass {
    kernel: wgpu::ComputePipeline,
    deep: u32,
}

/// A lattice on a card.
pub(crate) struct GpuLattice {
    shape: LatticeShape,
    settings: LatticeSettings,
    damping: f64,
    time_step: f64,
    card: Card,
    /// Displacements from rest: those of now and of the next step, in turn.
    places: [wgpu::Buffer; 2],
    /// The last step of each point.
    last: wgpu::Buffer,
    bindings: [wgpu::BindGroup; 2],
    passes: Vec<Pass>,
    measure: wgpu::ComputePipeline,
    parts: wgpu::Buffer,
    parts_here: wgpu::Buffer,
    places_here: wgpu::Buffer,
    pinned: Vec<bool>,
    bytes: u64,
    /// Which of the places are those of now.
    now: usize,
    steps: u64,
    motion: LatticeMotion,
}

/// Bytes of the buffers of a lattice: places, forces, and measures of workgroups.
#[derive(Clone, Copy)]
struct Sizes {
    places: u64,
    forces: u64,
    parts: u64,
}

impl Sizes {
    /// The sizes for `springs` stored forces a point.
    fn of(shape: &LatticeShape, springs: usize) -> Self {
        let count = shape.count();
        let [across, down] = shader::groups(count as u32);
        Self {
            places: 3 * count as u64 * NUMBER,
            forces: ((springs * count) as u64 * NUMBER).max(NUMBER),
            parts: u64::from(across) * u64::from(down) * 4 * NUMBER,
        }
    }

    fn greatest(self) -> u64 {
        self.places.max(self.forces)
    }
}

/// The vectors between two places of each point: all of x, all of y, all of z.
fn between(
    shape: &LatticeShape,
    from: impl Fn([usize; 3]) -> [f64; 3],
    to: impl Fn([usize; 3]) -> [f64; 3],
) -> Vec<f32> {
    let count = shape.count();
    let mut all = vec![0.0_f32; 3 * count];
    for (p, point) in shape.each().enumerate() {
        let (from, to) = (from(point), to(point));
        for c in 0..3 {
            all[c * count + p] = (to[c] - from[c]) as f32;
        }
    }
    all
}

/// One bit for each of a list.
fn bits(of: &[bool]) -> Vec<u32> {
    let word = |some: &[bool]| {
        let bits = some.iter().enumerate();
        bits.fold(0, |all, (k, is)| all | u32::from(*is) << k)
    };
    of.chunks(32).map(word).collect()
}

impl GpuLattice {
    /// A lattice where another one is, by one of [`super::GPU_METHODS`].
    ///
    /// # Errors
    /// There is no card, or it does not take the lattice.
    pub fn of<F: Number>(from: &Lattice<F>, method: &'static str) -> Result<Self, GpuError> {
        let card = Card::first()?;
        let (shape, settings) = (*from.shape(), *from.settings());
        let springs = match method {
            "edge" => settings.neighbours.half().len(),
            "point" => 1,
            _ => 0,
        };
        let sizes = Sizes::of(&shape, springs);
        if sizes.greatest() > card.most {
            return Err(GpuError::TooLarge {
                needed: sizes.greatest(),
                most: card.most,
                name: card.name,
            });
        }
        let made = card.checked(|| Self::made(&card, from, sizes, (method, springs)))?;
        let mut lattice = made(card);
        lattice.advance(0)?;
        Ok(lattice)
    }

    /// Makes what it needs on a card, of which the result takes hold.
    fn made<F: Number>(
        card: &Card,
        from: &Lattice<F>,
        sizes: Sizes,
        (method, springs): (&str, usize),
    ) -> impl FnOnce(Card) -> Self + use<F> {
        let (shape, settings) = (*from.shape(), *from.settings());
        let (damping, time_step) = (from.damping(), from.time_step());
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let here = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let displaced = between(
            &shape,
            |point| shape.at(point),
            |point| from.position(point),
        );
        let moved = between(
            &shape,
            |point| from.previous_position(point),
            |point| from.position(point),
        );
        // What is pinned stays in both.
        let places = [(); 2].map(|()| card.filled(&displaced));
        let last = card.filled(&moved);
        let pinned: Vec<bool> = shape.each().map(|p| from.is_pinned(p)).collect();
        let pinned_there = card.filled(&bits(&pinned));
        let forces = [(); 3].map(|()| card.buffer(sizes.forces, storage));
        let parts = card.buffer(sizes.parts, storage);
        let [parts_here, places_here] =
            [sizes.parts, sizes.places].map(|bytes| card.buffer(bytes, here));
        let text = shader::source(&shape, &settings, [time_step, damping]);
        let module = card
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: None,
                source: wgpu::ShaderSource::Wgsl(Cow::Owned(text)),
            });
        let layout = layout(&card.device);
        let bindings = [[0, 1], [1, 0]].map(|[now, next]| {
            let ([x, y, z], [now, next]) = (&forces, [now, next].map(|k| &places[k]));
            let all = [now, next, &last, &pinned_there, x, y, z, &parts];
            bind(&card.device, &layout, &all)
        });
        let kernel = |name: &str| kernel(&card.device, &module, &layout, name);
        let pass = |name: &str, deep: usize| Pass {
            kernel: kernel(name),
            deep: deep as u32,
        };
        let passes = match method {
            "edge" => vec![pass("scatter", springs), pass("collect", 1)],
            "point" => vec![pass("gather", 1), pass("integrate", 1)],
            _ => vec![pass("single", 1)],
        };
        let measure = kernel("measure");
        let of_pins = shape.count().div_ceil(8) as u64;
        move |card| Self {
            shape,
            settings,
            damping,
            time_step,
            places,
            last,
            bindings,
            passes,
            measure,
            parts,
            parts_here,
            places_here,
            pinned,
            bytes: 3 * sizes.places + 3 * sizes.forces + sizes.parts + of_pins,
            now: 0,
            steps: 0,
            motion: LatticeMotion::default(),
            card,
        }
    }

    pub fn shape(&self) -> &LatticeShape {
        &self.shape
    }

    pub fn settings(&self) -> &LatticeSettings {
        &self.settings
    }

    /// Damping c in use \[N s/m\].
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// Time step dt in use \[s\].
    pub fn time_step(&self) -> f64 {
        self.time_step
    }

    /// Number of steps so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The name of the card and of the interface to it.
    pub fn name(&self) -> &str {
        &self.card.name
    }

    /// Bytes on the card.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Which points are fixed.
    pub fn pinned(&self) -> &[bool] {
        &self.pinned
    }

    /// Forces and energies after the last steps.
    pub fn motion(&self) -> LatticeMotion {
        self.motion
    }

    /// Makes some steps, and measures the last. Returns the greatest move of a point in it [m].
    ///
    /// # Errors
    /// The card failed.
    pub fn advance(&mut self, steps: u64) -> Result<f64, GpuError> {
        self.submit(steps);
        let [across, down] = shader::groups(self.shape.count() as u32);
        let mut commands = self.card.device.create_command_encoder(&Default::default());
        {
            let mut pass = commands.begin_compute_pass(&Default::default());
            pass.set_bind_group(0, &self.bindings[self.now], &[]);
            pass.set_pipeline(&self.measure);
            pass.dispatch_workgroups(across, down, 1);
        }
        commands.copy_buffer_to_buffer(&self.parts, 0, &self.parts_here, 0, None);
        let copy = self.card.queue.submit([commands.finish()]);
        let found = self.card.read(&self.parts_here, &copy, <[f32]>::to_vec)?;
        let of = |k: usize| found.iter().skip(k).step_by(4).map(|n| f64::from(*n));
        let [speeds, stored] = [2, 3].map(|k| tree_sum(&of(k).collect::<Vec<_>>()));
        let [force, moved] = [0, 1].map(|k| max_or_nan(of(k)));
        // The greatest of numbers is not theirs where one is none; a sum is none then.
        let or_nan = |number: f64| match (speeds + stored).is_finite() {
            true => number,
            false => f64::NAN,
        };
        self.motion = LatticeMotion {
            residual: or_nan(force.sqrt()),
            kinetic: 0.5 * self.settings.mass * speeds,
            stored,
        };
        Ok(or_nan(moved.sqrt()))
    }

    /// Gives some steps to the card, without waiting for them.
    pub fn submit(&mut self, steps: u64) {
        let [across, down] = shader::groups(self.shape.count() as u32);
        let mut left = steps;
        while left > 0 {
            let several = left.min(AT_ONCE);
            let mut commands = self.card.device.create_command_encoder(&Default::default());
            {
                let mut pass = commands.begin_compute_pass(&Default::default());
                for _ in 0..several {
                    pass.set_bind_group(0, &self.bindings[self.now], &[]);
                    for Pass { kernel, deep } in &self.passes {
                        pass.set_pipeline(kernel);
                        pass.dispatch_workgroups(across, down, *deep);
                    }
                    self.now = 1 - self.now;
                }
            }
            self.card.queue.submit([commands.finish()]);
            left -= several;
        }
        self.steps += steps;
    }

    /// Waits for all that was given to the card.
    ///
    /// # Errors
    /// The card failed.
    pub fn wait(&self) -> Result<(), GpuError> {
        let done = self.card.device.poll(wgpu::PollType::wait_indefinitely());
        done.map(|_| ()).map_err(|error| self.card.failed(error))
    }

    /// Begins to copy the displacements of now; steps that follow do not wait for it.
    pub fn begin_to_read(&self) -> wgpu::SubmissionIndex {
        self.copy(&self.places[self.now])
    }

    /// Begins to copy numbers to where they can be read.
    fn copy(&self, from: &wgpu::Buffer) -> wgpu::SubmissionIndex {
        let mut commands = self.card.device.create_command_encoder(&Default::default());
        commands.copy_buffer_to_buffer(from, 0, &self.places_here, 0, None);
        self.card.queue.submit([commands.finish()])
    }

    /// The numbers of a copy \[m\]: all of x, all of y, all of z.
    ///
    /// # Errors
    /// The card failed.
    pub fn read(&self, copy: &wgpu::SubmissionIndex) -> Result<Vec<f32>, GpuError> {
        self.card.read(&self.places_here, copy, <[f32]>::to_vec)
    }

    /// What `deed` makes of the vector of each point of a copy.
    fn each<T>(
        &self,
        copy: &wgpu::SubmissionIndex,
        deed: impl Fn([usize; 3], [f64; 3]) -> T,
    ) -> Result<Vec<T>, GpuError> {
        let count = self.shape.count();
        self.card.read(&self.places_here, copy, |all| {
            let vector = |p: usize| [0, 1, 2].map(|c| f64::from(all[c * count + p]));
            let each = self.shape.each().enumerate();
            each.map(|(p, point)| deed(point, vector(p))).collect()
        })
    }

    /// Positions \[m\], x first.
    ///
    /// # Errors
    /// The card failed.
    pub fn positions(&self) -> Result<Vec<[f64; 3]>, GpuError> {
        self.each(&self.begin_to_read(), |point, by| {
            let rest = self.shape.at(point);
            [0, 1, 2].map(|c| rest[c] + by[c])
        })
    }

    /// The same lattice on the processor, in double precision.
    ///
    /// # Errors
    /// The card failed.
    pub fn to_cpu(&self) -> Result<Lattice<f64>, GpuError> {
        let settings = LatticeSettings {
            damping: Some(self.damping),
            time_step: Some(self.time_step),
            ..self.settings
        };
        let now = self.positions()?;
        let velocities = self.each(&self.copy(&self.last), |_, step| {
            step.map(|by| by / self.time_step)
        })?;
        // The shape and the settings are those of a lattice.
        let mut lattice =
            Lattice::unchecked(self.shape, settings).map_err(|error| self.card.failed(error))?;
        for (p, point) in self.shape.each().enumerate() {
            lattice.launch(point, now[p], velocities[p]);
            if self.pinned[p] {
                lattice.pin(point);
            }
        }
        Ok(lattice)
    }
}

/// The bindings of all kernels.
fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let is_read_only = [true, false, false, true, false, false, false, false];
    let entries: Vec<_> = (0..)
        .zip(is_read_only)
        .map(|(binding, read_only)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    })
}

fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &entries,
    })
}

fn kernel(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::BindGroupLayout,
    name: &str,
) -> wgpu::ComputePipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: Some(&layout),
        module,
        entry_point: Some(name),
        compilation_options: Default::default(),
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::{GPU_METHODS, LatticeError, Neighbours};
    use super::*;

    /// Steps of the comparison with the processor, and the greatest distance, in spacings.
    const STEPS: u64 = 1000;
    const APART: f64 = 1e-5;

    /// A lattice whose corner is pulled out and whose lowest layer is held.
    fn lattice(neighbours: Neighbours, mass: f64) -> Lattice<f64> {
        let shape = LatticeShape {
            points: [7, 5, 9],
            origin: [0.5, -3.0, 2.0],
            spacing: [0.25, 0.2, 0.3],
        };
        let settings = LatticeSettings {
            mass,
            time_step: Some(0.02),
            damping: Some(0.02),
            ..LatticeSettings::new(neighbours)
        };
        let mut lattice = Lattice::new(shape, settings).expect("a stable lattice");
        for point in shape.each() {
            let mut at = shape.at(point);
            if point[2] > 0 {
                let high = point[2] as f64 / 8.0;
                at[0] += 0.05 * high * high;
                at[2] += 0.02 * high;
            } else {
                lattice.pin(point);
            }
            lattice.place(point, at);
        }
        lattice.start_from_stillness();
        lattice
    }

    /// The lattice on a card; `None` where there is none.
    fn on_card(of: &Lattice<f64>, method: &'static str) -> Option<GpuLattice> {
        match GpuLattice::of(of, method) {
            Ok(lattice) => {
                eprintln!("on {}", lattice.name());
                Some(lattice)
            }
            Err(GpuError::NoDevice(why)) => {
                eprintln!("skipped: {why}");
                None
            }
            Err(error) => panic!("{error}"),
        }
    }

    fn apart(a: &Lattice<f64>, b: &GpuLattice) -> f64 {
        let positions = b.positions().expect("an answer");
        let each = a.positions().into_iter().zip(positions);
        let each = each.map(|(a, b)| {
            let squares = (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c]));
            squares.sum::<f64>().sqrt()
        });
        max_or_nan(each) / 0.2
    }

    #[test]
    fn a_card_makes_the_steps_of_the_processor() {
        for neighbours in Neighbours::ALL {
            let start = lattice(neighbours, 1.0);
            let mut exact = start.clone();
            exact.run(STEPS).expect("stable");
            let mut wrong = lattice(neighbours, 1.01);
            wrong.run(STEPS).expect("stable");
            for method in GPU_METHODS {
                let Some(mut card) = on_card(&start, method) else {
                    return;
                };
                assert!(
                    apart(&start, &card) <= 1e-7,
                    "displacements in single precision"
                );
                let moved = card.advance(STEPS).expect("an answer");
                let off = apart(&exact, &card);
                assert!(off <= APART, "{method}, {neighbours:?}: {off}");
                // Control: masses that are greater by a hundredth.
                assert!(
                    apart(&wrong, &card) > 10.0 * APART,
                    "{method}, {neighbours:?}"
                );
                assert_eq!(card.steps(), STEPS);
                let (here, there) = (exact.motion(), card.motion());
                for (a, b) in [
                    (here.residual, there.residual),
                    (here.kinetic, there.kinetic),
                    (here.stored, there.stored),
                ] {
                    assert!(
                        (a - b).abs() <= 1e-3 * a.abs(),
                        "{method}: {here:?} {there:?}"
                    );
                }
                let before = exact.positions();
                let mut next = exact.clone();
                next.step().expect("stable");
                let steps = before.iter().zip(next.positions());
                let step = steps.map(|(a, b)| {
                    let squares = (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c]));
                    squares.sum::<f64>().sqrt()
                });
                let step = max_or_nan(step);
                assert!((step - moved).abs() <= 0.1 * step, "{step} {moved}");
            }
        }
    }

    #[test]
    fn a_card_gives_the_same_bits_in_every_run_and_in_parts() {
        for method in GPU_METHODS {
            let start = lattice(Neighbours::TwentySix, 1.0);
            let run = |parts: &[u64]| {
                let mut card = on_card(&start, method)?;
                for steps in parts {
                    card.advance(*steps).expect("an answer");
                }
                Some((card.positions().expect("an answer"), card.motion()))
            };
            let (one, two, parts) = (run(&[150]), run(&[150]), run(&[1, 70, 79]));
            assert_eq!(one, two);
            assert_eq!(one, parts);
        }
    }

    #[test]
    fn a_lattice_at_rest_has_no_forces_and_a_reading_can_wait() {
        let shape = LatticeShape::unit_cube(6);
        let settings = LatticeSettings::new(Neighbours::Eighteen);
        let still = Lattice::<f64>::new(shape, settings).expect("stable");
        let Some(mut card) = on_card(&still, GPU_METHODS[0]) else {
            return;
        };
        assert_eq!(card.advance(10), Ok(0.0));
        assert_eq!(card.motion(), LatticeMotion::default());
        assert_eq!(apart(&still, &card), 0.0);
        // What is copied is that of the time when the copy begins.
        let moving = lattice(Neighbours::TwentySix, 1.0);
        let Some(mut card) = on_card(&moving, GPU_METHODS[0]) else {
            return;
        };
        let before = card.positions().expect("an answer");
        let copy = card.begin_to_read();
        card.submit(30);
        let read = card.read(&copy).expect("an answer");
        let rest = moving.shape().positions();
        let back = |p: usize| [0, 1, 2].map(|c| rest[p][c] + f64::from(read[c * rest.len() + p]));
        assert_eq!((0..rest.len()).map(back).collect::<Vec<_>>(), before);
        assert_ne!(card.positions().expect("an answer"), before);
        // A lattice that comes back from the card goes on as the one there.
        let mut back = card.to_cpu().expect("an answer");
        card.advance(20).expect("an answer");
        back.run(20).expect("stable");
        assert!(apart(&back, &card) <= APART);
        assert_eq!(card.pinned().iter().filter(|held| **held).count(), 35);
    }

    #[test]
    fn a_step_that_is_too_long_is_told() -> Result<(), LatticeError> {
        let settings = LatticeSettings {
            time_step: Some(10.0),
            ..LatticeSettings::new(Neighbours::TwentySix)
        };
        let shape = LatticeShape::unit_cube(4);
        let mut wild = Lattice::<f64>::unchecked(shape, settings)?;
        wild.place([1, 2, 3], [0.4, 0.1, 0.0]);
        if let Some(mut card) = on_card(&wild, GPU_METHODS[0]) {
            assert!(card.advance(200).expect("an answer").is_nan());
            assert!(card.motion().residual.is_nan());
        }
        Ok(())
    }

    #[test]
    fn the_workgroups_of_very_many_points_fit_into_a_dispatch() {
        for count in [1, 256, 257, 1_000_000, 8_000_000, 1 << 30] {
            let [across, down] = shader::groups(count);
            assert!(across <= shader::MOST_GROUPS && down <= shader::MOST_GROUPS);
            let threads = u64::from(across) * u64::from(down) * u64::from(shader::GROUP);
            assert!(threads >= u64::from(count));
            // Numbers of threads stay below 2^32.
            assert!(threads <= u64::from(u32::MAX), "{count}: {threads}");
        }
    }
}
